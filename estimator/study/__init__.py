"""Studies that reproduce Wang et al. 2024 ("the paper", see calibration/turn360.py): scenario → table → figure.

All studies are seeded and resumable. `study` defines a study, `runner` runs it, and `report` lists the paper's claims.
"""

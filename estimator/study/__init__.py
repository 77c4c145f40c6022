"""Studies that reproduce the paper: scenario → table → figure, seeded and resumable.

Begin at `study` (what a study is) and `runner`; `paper` lists the paper's claims.
"""

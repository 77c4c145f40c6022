"""The bus: one contract, and zenoh behind it.

Begin at `contract`; `zenoh_bus` implements it, `gap_repair` fetches what a subscription lacks.
"""

"""zenoh behind one contract: messages of each publisher in order and once, over losses and restarts.

Begin at `contract`; `zenoh_bus` implements it, `gap_repair` fetches what a subscription lacks.
"""

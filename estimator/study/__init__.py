"""Studies of the paper: scenario → table → figure, seeded and resumable.

Begin at `study` (what a study is) and `runner`; `paper` lists what the paper claims.
"""

"""One device: samples in; corrected rates, calibrations and a status out. No clock, socket, file or thread.

Begin at `session`; `lifecycle` is the table of its states, `admission` decides which messages are taken, `correction` what is
applied.
"""

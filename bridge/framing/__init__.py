"""Byte framing without I/O: decoders from bytes in any chunking to whole packets, with bounded memory. Damaged data is counted.

Begin at `cobs_frames`; each protocol is one file.
"""

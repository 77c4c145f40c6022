"""Byte framing without I/O: any chunking of bytes in, whole packets out, damaged packets counted, bounded memory.

Begin at `cobs_frames`; each protocol is one file.
"""

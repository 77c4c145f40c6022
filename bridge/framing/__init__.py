"""Bytes to packets, without I/O: any chunking in, whole packets out, damaged ones counted, bounded memory.

Begin at `cobs_frames`; one protocol a file.
"""

"""Framing without I/O: bytes in any chunking, packets and counted faults out."""

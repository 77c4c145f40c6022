"""Tolerant reader of text tables: any separator, decimal mark, encoding, preamble and header; columns found by name."""

"""Tolerant reader of text: any separator, decimal mark, encoding, preamble and header, by the names of its columns."""

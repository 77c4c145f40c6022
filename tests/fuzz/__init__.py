"""Bytes that no device sends, for every decoder there is."""

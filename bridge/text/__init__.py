"""Devices that print lines: what a profile says of one, and how its lines become samples."""

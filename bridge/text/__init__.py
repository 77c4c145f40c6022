"""Devices that print lines: a TOML profile describes them, and their lines become readings.

Begin at `profile`; `line_parser` turns one line into numbers or refuses it with a reason.
"""

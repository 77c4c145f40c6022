"""Text devices: a TOML profile describes a device's lines, and the lines become readings.

Begin at `profile`; `line_parser` turns one line into numbers or refuses it with a reason.
"""

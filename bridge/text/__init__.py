"""Reader of devices that print text lines: a TOML profile describes the lines, and lines become readings.

Begin at `profile`; `line_parser` converts one line to numbers, or refuses it with a reason.
"""

"""Terminal output: a console safe for foreign text, tables that fit the terminal's width, a progress bar, plurals.

Begin at `console`.
"""

"""Text for people on a terminal: a console that prints foreign text as text, tables that fit, a progress bar, plurals.

Begin at `console`.
"""

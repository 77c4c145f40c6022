"""Texts for people, in each language; the text files are in `web/texts`.

Start reading at `texts`.
"""

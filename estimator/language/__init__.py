"""Texts for people, in each language; the files are in `web/texts`.

Start reading at `texts`.
"""

"""Reasons as codes with parameters, and the catalogue that translates codes to text, with one file per language."""

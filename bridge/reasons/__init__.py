"""Reasons as codes with parameters, and the catalogue that turns codes into text, with one file per language."""

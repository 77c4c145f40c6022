"""Calibrates and tracks every gyroscope of a ward, and republishes corrected rates.

docs/architecture.md maps the rooms. The Python door is the package `truerate`.
"""

"""A ward, its needs and its estimators as plain values, made of what the bus says. Pure.

Begin at `ward`.
"""

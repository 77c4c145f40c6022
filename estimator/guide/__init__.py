"""What a person who calibrates a device by hand is told, step by step. Pure: it follows the stream and needs no click.

Begin at `guide`.
"""

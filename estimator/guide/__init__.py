"""Step-by-step instructions for a person who calibrates a device by hand. Pure: follows the stream and needs no click.

Begin at `guide`.
"""

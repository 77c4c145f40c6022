"""Packets to identities and readings; one protocol a file, named in `registry`.

Begin at `driver` (the contract) and `byte_stream` (what every driver of a byte device shares). Drivers of other packages
register under the entry point `truerate.drivers`.
"""

"""Device drivers: packets to identities and readings. Each protocol is one file, listed in `registry`.

Begin at `driver` (the contract) and `byte_stream` (shared by all drivers of byte devices). Other packages register
their drivers under the entry point `truerate.drivers`.
"""

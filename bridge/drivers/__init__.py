"""Device drivers, which decode a device's data to identities and readings. Each protocol is one file, listed in `registry`.

Begin at `driver` (the interface) and `byte_stream` (shared by all drivers of devices that send bytes). Other packages
register their drivers under the entry point `truerate.drivers`.
"""

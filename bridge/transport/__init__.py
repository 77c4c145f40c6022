"""Byte transports of devices: serial, TCP, UDP, BLE and files, a module for each kind.

A transport returns bytes with their receive time. Its only errors are `errors.DeviceUnavailable` and
`errors.DeviceLost`.
Begin at `transport` (the interface) and `address` (which transport an address names).
"""

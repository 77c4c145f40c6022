"""Byte transports: serial, TCP, UDP, BLE and files; one kind a file.

A transport gives bytes with their receive time and raises `errors.DeviceUnavailable` or `errors.DeviceLost`, nothing else.
Begin at `transport` (the contract) and `address` (which transport an address names).
"""

"""Byte transports: what carries a device's bytes."""

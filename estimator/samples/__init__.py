"""Samples of one device and boot as columns, their buffer, and blocks of half a second or a second of device time."""

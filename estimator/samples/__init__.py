"""Samples of one device and boot as columns, the buffer that holds them, and blocks of a second of device time."""

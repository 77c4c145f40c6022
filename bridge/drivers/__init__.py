"""Drivers: one file a device kind behind one small contract."""

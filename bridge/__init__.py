"""Devices in, zenoh out: the bridge reads IMUs and owns the wire language."""

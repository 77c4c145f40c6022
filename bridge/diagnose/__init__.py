"""Diagnosis of faults with advice: the checks of `truerate doctor`, the port scan, and recognition of a device's protocol.

Begin at `finding`; `protocol_guess` recognises a device by its bytes.
"""

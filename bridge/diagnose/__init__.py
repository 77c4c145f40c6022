"""Diagnosis of faults, with what to do: the checks of `truerate doctor`, the port scan, a profile tried on a capture.

Begin at `finding`; `protocol_guess` recognises a device by its bytes.
"""

"""Certificates and roles: made here, or brought along, and checked before they are shown to a router.

Begin at `member` (who a certificate is for) and `folder` (a ward's authority).
"""

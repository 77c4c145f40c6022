"""Certificates and roles: creates certificates, and checks certificates before a connection to a router.

Begin at `member` (the holder of a certificate) and `folder` (a ward's certificate authority).
"""

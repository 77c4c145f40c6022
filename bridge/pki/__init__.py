"""Certificates and roles: issue certificates, and check own or foreign ones before a connection to a router.

Begin at `member` (the holder of a certificate) and `folder` (a ward's certificate authority).
"""

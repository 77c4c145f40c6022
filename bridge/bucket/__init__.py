"""Copies of backups and recordings in a bucket of S3-compatible storage, of which truerate deletes nothing.

`bucket.py` has the table [s3] and talks to the storage; `mirror.py` copies finished files on its own thread.
"""

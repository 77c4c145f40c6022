"""Copies of backups and recordings in a bucket of S3-compatible storage, of which truerate deletes nothing.

`settings.py` is the table [s3], `bucket.py` talks to the storage, `mirror.py` copies finished files on its own thread.
"""

"""Backups and recordings copied to a bucket of S3-compatible storage. truerate never deletes an object there.

`bucket.py` reads the table [s3] of the ward file and calls the storage. `mirror.py` copies finished files on its own
thread.
"""

"""Readers of recordings, a module per file format: `read(path, reading)` returns a Table. Begin at `registry.py`.

Text tables have a room of their own, `bridge.recording.text`. `hdf5` and `parquet` also write.
"""

"""Readers of recordings, one module per file format: `read(path, reading)` returns a Table. Begin at `registry.py`.

Text tables are read by `bridge.recording.text`. `hdf5` and `parquet` also write.
"""

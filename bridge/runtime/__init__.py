"""Process runtime: logging, metrics, health server, signals, file writing, and operating system errors in plain words.

Imports no other package of truerate. Begin at `logs` or `health_server`.
"""

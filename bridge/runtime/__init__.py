"""Process runtime: logging, metrics, health server, signals, and operating system errors in plain words.

Depends on no other room. Begin at `logs` or `health_server`.
"""

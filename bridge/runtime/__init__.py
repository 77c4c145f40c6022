"""What every process needs: logging, metrics, the health server, signals, the operating system's errors in plain words.

Depends on no other room. Begin at `logs` or `health_server`.
"""

"""Limit of open files and connections of this process. On Windows nothing is changed."""

import logging
import sys

if sys.platform != "win32":
    import resource

log = logging.getLogger(__name__)


def make_room(wanted: int) -> int:
    """Raise the process's limit of open files and connections to `wanted`, as far as the system allows.

    Returns the number of files and connections that may be open, at most `wanted`. If it is less, a warning is logged.
    """
    most = wanted
    if sys.platform != "win32":
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        if resource.RLIM_INFINITY != soft < wanted:
            most = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
    if most < wanted:
        log.warning("only %d files may be open, and %d may be needed: raise the limit (ulimit -Hn)", most, wanted)
    return most

"""The number of files and connections that a program may have open. Windows has no limit that matters."""

import logging
import sys

if sys.platform != "win32":
    import resource

log = logging.getLogger(__name__)


def make_room(wanted: int) -> int:
    """Raise the limit of open files and connections to `wanted`, if needed and possible; return how many may be open.

    The result is at most `wanted`. Logs a warning if it is less.
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

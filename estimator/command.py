"""Where `truerate` begins. Loading the rest takes a second; who presses Ctrl-C meanwhile gets no traceback."""

import os
import sys

# What `signal` is made of: it alone takes half as long to load as Python does, and Ctrl-C would be a traceback meanwhile.
from _signal import SIG_IGN, SIGINT, default_int_handler, getsignal, signal  # type: ignore[import-not-found]

INTERRUPTED = 130


def main() -> int:
    """Load the command line, and run one command; the exit code."""
    if getsignal(SIGINT) is not SIG_IGN:  # as with a shell's `&`
        signal(SIGINT, _leave)
    try:
        from estimator import cli  # noqa: PLC0415 - what is waited for

        code = cli.main()
    finally:
        if getsignal(SIGINT) is default_int_handler:
            signal(SIGINT, _leave)  # what is still to be done is Python's own
    return over(code)


def interruptible() -> None:
    """Who is to be told by KeyboardInterrupt is ready for it."""
    if getsignal(SIGINT) is _leave:
        signal(SIGINT, default_int_handler)


def over(code: int) -> int:
    """End with this exit code; without zenoh nothing is done, and the code given back.

    As Python ends, but for taking itself apart: a thread that comes back from zenoh meanwhile aborts the process.
    """
    if "zenoh" not in sys.modules:
        return code
    import atexit  # noqa: PLC0415
    import threading  # noqa: PLC0415

    threading._shutdown()  # type: ignore[attr-defined]  # noqa: SLF001 - nothing else waits for all threads
    atexit._run_exitfuncs()  # noqa: SLF001
    try:
        for stream in filter(None, (sys.stdout, sys.stderr)):
            stream.flush()
    except (OSError, ValueError):
        return code  # Python says what is wrong
    os._exit(code)


def _leave(*_: object) -> None:
    os._exit(INTERRUPTED)

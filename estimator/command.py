"""Where `truerate` begins. Loading the rest takes a second; who presses Ctrl-C meanwhile gets no traceback."""

import os

# What `signal` is made of: it alone takes half as long to load as Python does, and Ctrl-C would be a traceback meanwhile.
from _signal import SIG_IGN, SIGINT, default_int_handler, getsignal, signal  # type: ignore[import-not-found]

INTERRUPTED = 130


def main() -> int:
    """Load the command line, and run one command; the exit code."""
    if getsignal(SIGINT) is not SIG_IGN:  # as with a shell's `&`
        signal(SIGINT, _leave)
    try:
        from estimator import cli  # noqa: PLC0415 - what is waited for

        return cli.main()
    finally:
        if getsignal(SIGINT) is default_int_handler:
            signal(SIGINT, _leave)  # what is still to be done is Python's own


def interruptible() -> None:
    """Who is to be told by KeyboardInterrupt is ready for it."""
    if getsignal(SIGINT) is _leave:
        signal(SIGINT, default_int_handler)


def _leave(*_: object) -> None:
    os._exit(INTERRUPTED)

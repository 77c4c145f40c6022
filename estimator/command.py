"""Where `truerate` begins. Loading the rest takes a second; who presses Ctrl-C meanwhile gets no traceback."""

import signal


def main() -> int:
    """Load the command line, and run one command; the exit code."""
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    from estimator import cli  # noqa: PLC0415 - what is waited for

    signal.signal(signal.SIGINT, before)
    return cli.main()

"""Where `truerate` begins. Loading the rest takes a second; Ctrl-C meanwhile ends it without a traceback."""

INTERRUPTED = 130


def main() -> int:
    """Load the command line, and run one command; the exit code."""
    try:
        from estimator import cli  # noqa: PLC0415 - what is waited for

        return cli.main()
    except KeyboardInterrupt:
        return INTERRUPTED

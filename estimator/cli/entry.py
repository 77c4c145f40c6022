"""Entry point of `truerate`; Ctrl-C while the rest loads ends it without a traceback."""

INTERRUPTED = 130


def main() -> int:
    """Load the command line, and run one command; the exit code."""
    try:
        from estimator.cli import main as cli  # noqa: PLC0415 - what is waited for

        return cli.main()
    except KeyboardInterrupt:
        return INTERRUPTED

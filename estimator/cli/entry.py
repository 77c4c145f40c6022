"""Entry point of the command `truerate`; Ctrl-C during loading ends it without a traceback."""

INTERRUPTED = 130


def main() -> int:
    """Load the command line and run one command; returns the exit code."""
    try:
        from estimator.cli import main as cli  # noqa: PLC0415 - the slow part of the start

        return cli.main()
    except KeyboardInterrupt:
        return INTERRUPTED

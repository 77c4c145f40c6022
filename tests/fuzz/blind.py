"""Damaged messages, drawn: `python -m tests.fuzz.blind native 10000000`."""

import resource
import sys
import time

import numpy as np

from tests.fuzz.executions import Target, inputs

_SAID_EVERY_S = 10.0


def main(name: str, runs: int) -> None:
    """Raises what the decoder raises, after the input that did it."""
    target, rng = Target(name), np.random.default_rng()
    begun = said = time.monotonic()
    while target.executions < runs:
        for data in inputs(target.seeds, rng, min(20_000, runs - target.executions)):
            try:
                target.feed(data)
            except BaseException:
                print(f"{name}: {data.hex()}", file=sys.stderr)
                raise
        if time.monotonic() - said > _SAID_EVERY_S:
            said = time.monotonic()
            print(f"{name}: {_progress(target, said - begun)}", flush=True)
    print(f"{name}: done, {_progress(target, time.monotonic() - begun)}", flush=True)


def _progress(target: Target, spent_s: float) -> str:
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return (
        f"{target.executions:,} executions, {target.events:,} events, {target.faults:,} faults counted, "
        f"{target.executions / spent_s:,.0f} a second, {memory_mb:.0f} MB at most"
    )


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))

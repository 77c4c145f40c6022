"""Writes calibrations until it is killed, and prints the number of each that is acknowledged.

python -m tests.estimator.database.writing STORE FIRST
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from estimator.service.store import Store
from estimator.service.store_writer import StoreWriter
from tests.estimator.database.kept import CALIBRATIONS, bias
from tests.estimator.stream import NAME


def write(path: str, number: int, said: Callable[[int], None]) -> None:
    """Calibrations of boots from a number on, each with a bias; said: told the number of each once it is acknowledged."""
    store = Store(path)
    clerk = StoreWriter(store.database)
    while True:
        number += 1
        c = replace(CALIBRATIONS[0], id=f"k{number}", boot=number, time_ns=number)
        clerk.do(partial(store.add_calibration, c), lambda error, n=number: said(n) if error is None else None)  # type: ignore[misc]
        clerk.do(partial(store.save_bias, NAME, number, number, bias(number), history=True), soon=False)
        while not clerk.idle:
            clerk.collect()
        clerk.collect()


if __name__ == "__main__":
    write(sys.argv[1], int(sys.argv[2]), lambda n: print(n, flush=True))  # noqa: T201

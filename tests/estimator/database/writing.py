"""Writes calibrations until it is killed, or so many, and prints the number of each that is acknowledged.

python -m tests.estimator.database.writing STORE FIRST [MANY]
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from estimator.service.store import Store
from estimator.service.store_writer import StoreWriter
from tests.estimator.database.kept import CALIBRATIONS, bias
from tests.estimator.stream import NAME


def write(path: str, first: int, said: Callable[[int], None], many: int = sys.maxsize) -> None:
    """Calibrations of boots after a number, each with a bias, and a backup; said: told the number of each once acknowledged."""
    store = Store(path, patient=True)
    clerk = StoreWriter(store.database)
    for number in range(first + 1, first + many + 1):
        c = replace(CALIBRATIONS[0], id=f"k{number}", boot=number, time_ns=number)
        clerk.do(partial(store.add_calibration, c), lambda error, n=number: said(n) if error is None else None)  # type: ignore[misc]
        clerk.do(partial(store.save_bias, NAME, number, number, bias(number), history=True), soon=False)
        while not clerk.idle:
            clerk.collect()
        clerk.collect()
    store.database.back_up_if_due()
    clerk.close()
    store.close()


if __name__ == "__main__":
    write(sys.argv[1], int(sys.argv[2]), lambda n: print(n, flush=True), *map(int, sys.argv[3:]))  # noqa: T201

"""The queue is the one of the books, devices are shared out evenly, and a ward that is too small for its death says so."""

from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from estimator.study.scaling import Costs, run, shares, simulate, waited

COSTS = Costs(message_s=150e-6, router_s=12e-6, known_s=0.1)


def test_one_server_takes_one_after_the_other() -> None:
    np.testing.assert_allclose(waited(np.array([0.0, 0.1, 0.2, 5.0]), 1.0), [1.0, 1.9, 2.8, 1.0])


def test_random_arrivals_wait_as_pollaczek_and_khinchine_say() -> None:
    load = 0.8
    arrivals = np.cumsum(np.random.default_rng(1).exponential(1 / load, 400_000))
    assert waited(arrivals, 1.0).mean() == pytest.approx(1 + load / (2 * (1 - load)), rel=0.05)


def test_shares_are_even_and_a_ward_of_its_own_has_its_own() -> None:
    counts = np.bincount(shares(3000, 3), minlength=3)
    assert counts.sum() == 3000
    np.testing.assert_allclose(counts, 1000, rtol=0.1)
    assert not np.array_equal(shares(3000, 3), shares(3000, 3, ward=1))


def test_a_death_is_outlived_where_there_is_room_for_it() -> None:
    few, more = simulate(1000, 2, COSTS), simulate(1000, 3, COSTS)
    assert few.load < 1 < few.after
    assert few.caught_up == np.inf
    assert more.caught_up < 1.0
    assert COSTS.known_s < more.worst < COSTS.known_s + 0.2
    assert more.p50 < more.p99 < more.worst


def test_run_tells_what_is_needed(tmp_path: Path) -> None:
    console = Console(record=True, width=120)
    run(console, COSTS, 10_000, 1000, tmp_path / "s.png")
    said = console.export_text()
    assert "10,000 devices are 10 wards with 3 estimators each" in said.replace("\n", " ")
    assert (tmp_path / "s.png").stat().st_size > 10_000
    console = Console(record=True, width=120)
    run(console, Costs(5e-3, 0.0, 0.1), 10_000, 1000, tmp_path / "none.png")
    assert "make wards smaller" in console.export_text()

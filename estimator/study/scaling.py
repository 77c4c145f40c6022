"""How far many estimators reach: devices shared out as the service does it, messages queued as they would be, one dying.

Every estimator is one server that takes messages in the order they come, `message_s` of its core for each. What it costs is
measured (`make bench-load`); the rest follows from it. Time of all devices is random, as their clocks are.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from bridge.columns import Column, Columns
from estimator import figures
from estimator.service.ownership import owner

Floats = NDArray[np.float64]

#: messages a second of one device: 104 Hz, ten samples in each
RATE_HZ = 10.4
#: a message that waits longer is late
LATE_S = 0.02
_BEGIN_S, _DIES_S, _END_S = 2.0, 6.0, 16.0


@dataclass(frozen=True, slots=True)
class Costs:
    """What was measured: seconds of a core for each message, in the estimator and in the router; s until a death is known."""

    message_s: float
    router_s: float
    known_s: float


@dataclass(frozen=True, slots=True)
class Ward:
    """Seconds from a message's arrival to its corrected one. quiet: p50 and p99 while all live; worst of all messages.

    load: share of the busiest estimator's core while all live; after: the same when one has died. caught_up: how long after
    the death the last message comes that is late, inf when there is no last.
    """

    load: float
    after: float
    p50: float
    p99: float
    worst: float
    caught_up: float


def shares(devices: int, estimators: int, ward: int = 0) -> NDArray[np.int64]:
    """(devices,) which of so many estimators owns each device of a ward, by name."""
    names = [f"ward{ward}-estimator{number}" for number in range(estimators)]
    numbers = {name: number for number, name in enumerate(names)}
    return np.array([numbers[owner(f"ward{ward}-d{device}", names)] for device in range(devices)])


def waited(arrivals: Floats, each_s: float) -> Floats:
    """(n,) seconds until each of n messages is done, that come at these times, in order, to one server: Lindley's recursion."""
    before = each_s * np.arange(len(arrivals))
    done: Floats = np.maximum.accumulate(arrivals - before) + before + each_s
    return done - arrivals


def simulate(devices: int, estimators: int, costs: Costs, ward: int = 0) -> Ward:
    """A ward of which one estimator dies, if there are others."""
    rng = np.random.default_rng(ward)
    owners, phases = shares(devices, estimators, ward), rng.uniform(0.0, 1 / RATE_HZ, devices)
    busiest = int(np.bincount(owners, minlength=estimators).argmax())
    rounds = np.arange(round(_END_S * RATE_HZ)) / RATE_HZ
    sent = phases[:, None] + rounds
    load = float(np.bincount(owners).max()) * RATE_HZ * costs.message_s
    if estimators == 1:
        quiet = waited(np.sort(sent[:, rounds >= _BEGIN_S].ravel()), costs.message_s)
        return Ward(load, np.inf, *_percentiles(quiet), float(quiet.max()), np.inf)
    names = [f"ward{ward}-estimator{number}" for number in range(estimators) if number != busiest]
    numbers = [number for number in range(estimators) if number != busiest]
    heirs = owners.copy()
    for device in np.flatnonzero(owners == busiest):
        heirs[device] = numbers[names.index(owner(f"ward{ward}-d{device}", names))]
    found = [_lived(sent, owners, heirs, number, costs) for number in numbers]
    came, took = (np.concatenate(column) for column in zip(*found, strict=True))
    p50, p99 = _percentiles(took[(came > _BEGIN_S) & (came < _DIES_S)])
    late = came[(came > _DIES_S) & (took > LATE_S)]
    caught_up = float(late.max(initial=_DIES_S)) - _DIES_S
    after = float(np.bincount(heirs).max()) * RATE_HZ * costs.message_s
    return Ward(load, after, p50, p99, float(took.max()), caught_up if caught_up < _END_S - _DIES_S - 1.0 else np.inf)


def run(console: Console, costs: Costs, total: int, per_ward: int, picture: Path) -> None:
    """Print what a ward of `per_ward` devices needs, and `total` devices in such wards; leave a picture."""
    headings = ("estimators", "load", "one dead", "p50", "p99", "worst wait", "caught up after")
    table = Columns(
        [Column(heading, number=True) for heading in headings],
        title=f"A ward of {per_ward} devices at 104 Hz, one estimator dying ({1e6 * costs.message_s:.0f} µs a message)",
    )
    enough, found = 0, {}
    for estimators in range(1, 9):
        ward = found[estimators] = simulate(per_ward, estimators, costs)
        table.add(
            str(estimators),
            f"{ward.load:.0%}",
            "-" if estimators == 1 else f"{ward.after:.0%}",
            f"{1e3 * ward.p50:.1f} ms",
            f"{1e3 * ward.p99:.1f} ms",
            f"{ward.worst:.2f} s",
            f"{ward.caught_up:.2f} s" if np.isfinite(ward.caught_up) else "never",
        )
        enough = enough or (estimators if np.isfinite(ward.caught_up) else 0)
    console.print(table)
    if not enough:
        console.print("No number of estimators up to eight outlives the death of one: make wards smaller.")
        return
    wards = -(-total // per_ward)
    uneven = [
        np.bincount(shares(per_ward, enough, number), minlength=enough) * enough / per_ward
        for number in track(range(wards), "sharing devices out", console=console, transient=True)
    ]
    router = per_ward * RATE_HZ * 2 * costs.router_s
    console.print(
        f"{total:,} devices are {wards:,} wards with {enough} estimators each: {wards * enough:,} estimators, "
        f"{total * RATE_HZ * costs.message_s:,.0f} cores busy; in a ward's router {router:.0%} of a core; "
        f"shares of devices from {np.min(uneven):.0%} to {np.max(uneven):.0%} of even"
    )
    picture.parent.mkdir(parents=True, exist_ok=True)
    figures.scaling({n: (w.load, w.after, w.p99, w.worst) for n, w in found.items() if n > 1}, per_ward, picture)
    console.print(f"Picture: {picture}")


def _percentiles(took: Floats) -> tuple[float, float]:
    p50, p99 = np.percentile(took, (50, 99))
    return float(p50), float(p99)


def _lived(
    sent: Floats, owners: NDArray[np.int64], heirs: NDArray[np.int64], number: int, costs: Costs
) -> tuple[Floats, Floats]:
    """When messages (n,) came that one estimator took, and how long (n,) each took; what it inherits waits to be known."""
    mine, inherited = sent[owners == number].ravel(), sent[(owners != number) & (heirs == number)].ravel()
    inherited = inherited[inherited >= _DIES_S]
    came = np.concatenate([mine, inherited])
    ready = np.concatenate([mine, np.maximum(inherited, _DIES_S + costs.known_s)])
    order = np.argsort(ready, kind="stable")
    came, ready = came[order], ready[order]
    took: Floats = waited(ready, costs.message_s) + ready - came
    return came, took

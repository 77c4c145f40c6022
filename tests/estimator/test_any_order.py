"""Repeats and any order within the window: what is published is, to the bit, that of each sample once and in its turn."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from bridge.sim.motion import Still
from bridge.sim.script import swing
from bridge.wire.messages import Calibration, CorrectedBatch, Quality, SampleBatch
from estimator.service.quota import SHARE
from estimator.session import DeviceSession
from estimator.track.bias_filter import BiasState
from tests.conftest import Effort
from tests.estimator.served import NOW_NS, Served, columns, numbers
from tests.estimator.stream import NAME, Stream, calibration, feed

RATE_HZ, BOOT = 52.0, 7
#: a service for so many devices, one after the other
DEVICES = 25


@dataclass(frozen=True, slots=True)
class Lived:
    """A device that was calibrated, and its samples from then on: at rest, moved, at rest."""

    samples: Stream
    first: int
    calibration: Calibration
    bias: BiasState


@pytest.fixture(scope="module")
def lived() -> Lived:
    of = calibration(seed=4, after=[Still(1.5), swing(np.random.default_rng(4), 1.0, 1.0), Still(6.0)], rate_hz=RATE_HZ)
    session = DeviceSession(NAME)
    first = of.at(of.time[-1] - 8.0)
    feed(session, of.part(0, first).batches(boot=BOOT))
    bias = session.checkpoint()
    assert session.calibration is not None
    assert bias is not None
    return Lived(of.part(first, len(of)), first, session.calibration, bias)


def deranged(rng: np.random.Generator, of: Stream, n: int, first: int) -> list[SampleBatch]:
    """The first n samples in batches of any length; some twice, some stretches again in other batches; in any order."""

    def cut(begin: int, end: int) -> list[SampleBatch]:
        edges = np.unique(rng.integers(1, end - begin, (end - begin) // 7)).tolist()
        return of.part(begin, end).batches(edges, boot=BOOT, first=first + begin)

    batches = cut(0, n)
    for _ in range(int(rng.integers(0, 3))):
        begin = int(rng.integers(0, n - 8))
        batches += cut(begin, min(n, begin + int(rng.integers(8, 60))))
    batches += [batches[i] for i in rng.integers(0, len(batches), int(rng.integers(0, 6)))]
    displaced = rng.choice([3.0, 30.0, float(n)])
    at = [batch.sequence + rng.uniform(0, displaced) for batch in batches]
    return [batches[i] for i in np.argsort(at)]


class Devices:
    """One service, to which the same boot comes again and again under other names."""

    def __init__(self, served: Served, lived: Lived) -> None:
        self._served, self._lived = served, lived
        self._n = 0

    def said(self, batches: list[SampleBatch], rounds: list[int], *, calibrated: bool) -> list[CorrectedBatch]:
        """What is published when these come, so many in each round, all within the window."""
        name, served = f"d{self._n}", self._served
        self._n += 1
        if calibrated:
            made = self._lived.calibration
            served.store.add_calibration(replace(made, device=name, id=f"{name}-{made.id}"))
            served.store.save_bias(name, BOOT, NOW_NS, self._lived.bias, history=False)
        said: list[CorrectedBatch] = []
        at = 0
        for n in rounds:
            for batch in batches[at : at + n]:
                served.put(replace(batch, device=name))
            at += n
            said += served.round()
        said += served.rest()
        status = served.service._devices.pop(name).status(1)
        assert status.samples_in == sum(map(len, batches)) == status.samples_out + sum(status.dropped.values())
        assert set(status.dropped) <= {"duplicate"}
        return [replace(batch, calibration=batch.calibration[len(name) :]) for batch in said]


@pytest.mark.soak
def test_no_order_and_no_repeat_within_the_window_changes_a_bit(effort: Effort, lived: Lived) -> None:
    left, seed = effort(200, 100_000), effort.seed
    expected: dict[tuple[int, int, bool], tuple[bytes, ...]] = {}
    while left:
        with Served() as served:
            devices = Devices(served, lived)
            for _ in range(min(left, DEVICES)):
                rng = np.random.default_rng(seed)
                n, first = int(rng.choice([78, 130])), int(rng.choice([0, lived.first]))
                calibrated = bool(rng.integers(0, 2))
                if (n, first, calibrated) not in expected:
                    whole = lived.samples.part(0, n).batches(boot=BOOT, first=first)
                    said = devices.said(whole, [1] * len(whole), calibrated=calibrated)
                    assert n < 130 or len({b.bias.tobytes() for b in said}) > 1, "it learns meanwhile"
                    assert (Quality.GOOD in {b.quality for b in said}) is calibrated
                    expected[n, first, calibrated] = columns(said)
                batches = deranged(rng, lived.samples, n, first)
                rounds = rng.integers(1, 9, len(batches)).tolist()
                found = columns(devices.said(batches, rounds, calibrated=calibrated))
                assert found == expected[n, first, calibrated], f"seed {seed}"
                seed, left = seed + 1, left - 1


def test_what_is_missing_is_waited_for_while_it_waits_for_its_round(lived: Lived) -> None:
    batches = lived.samples.part(0, 400).batches(list(range(4, 400, 4)), boot=BOOT)
    batches.insert(1 + 2 * SHARE, batches.pop(SHARE - 1))  # the first of the third part
    with Served() as served:
        for batch in batches:
            served.put(batch)
        said = served.round()
        assert len(numbers(said)) < 400
        for _ in range(4):
            said += served.round(1.0)
        said += served.rest()
        assert numbers(said) == [(BOOT, number) for number in range(400)]

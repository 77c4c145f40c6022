from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from bridge.sim.motion import Piece, Spin, Still
from estimator.tracking.bias_filter import BiasFilter
from estimator.tracking.bias_state import OWN, BiasKnobs, start
from estimator.tracking.evidence import Evidence, Receipt
from estimator.tracking.seconds import Second
from estimator.tracking.tilt_check import OVER_S, SETTLED_S
from estimator.tracking.zaru import REFUSED_TILT, UNPROVEN, Zaru
from estimator.tracking.zaru_limits import INSIST_S, PROVEN_AFTER
from estimator.tracking.zaru_limits import QUASI_STATIC as MOTION
from estimator.tracking.zaru_limits import UNPROVEN as UNPROVEN_STD
from tests.estimator.stream import Floats, Stream, stream
from tests.estimator.tracking.worn import LEVEL, PLAIN, Worn, rest

BIAS = np.radians([1.0, -2.0, 0.5])
UP = np.array([0.0, 0.0, 1.0])
N = 104


class Rest:
    """A device that rests, its seconds made directly; `up` in device axes where it has an accelerometer."""

    def __init__(self, noise_dps: float = 0.03, seed: int = 0, up: Floats | None = None) -> None:
        self.rng = np.random.default_rng(seed)
        self.noise = np.radians(noise_dps)
        self.time = 0.0
        self.up = up
        self.zaru = Zaru()
        knobs = BiasKnobs()
        self.filter = BiasFilter(start(BIAS, np.radians(0.005) ** 2 * np.eye(3), 0.0, knobs), knobs)

    def seconds(self, seconds: float, offset: Floats | float = 0.0, *, still: bool = True) -> Iterator[Second]:
        accel_std = None if self.up is None else np.full(3, 0.02)
        for _ in range(round(seconds)):
            mean = BIAS + offset + self.noise / np.sqrt(N) * self.rng.normal(size=3)
            std, none = np.full(3, self.noise), np.zeros((N, 3))
            begin, self.time = self.time, self.time + 1.0
            accel = None if self.up is None else 9.81 * self.up + 0.02 / np.sqrt(N) * self.rng.normal(size=3)
            yield Second(
                begin, self.time, np.full(N, 1 / N), none, None, still, "",
                mean, std, std**2 / N, np.zeros(3), std, accel, accel_std,
            )  # fmt: skip

    def take(self, second: Second) -> list[Receipt]:
        self.filter.predict(second.end)
        if not self.zaru.at_rest(second):
            self.zaru.interrupted(self.filter, 1.0)
            return []
        return self.zaru.take(second, self.filter, self.up)[0]

    def lives(self, seconds: float, offset_dps: float = 0.0, *, axis: int = 2, still: bool = True) -> list[Receipt]:
        offset = np.radians(offset_dps) * np.eye(3)[axis]
        return [r for second in self.seconds(seconds, offset, still=still) for r in self.take(second)]

    def moves(self, seconds: float) -> None:
        self.time += seconds
        self.zaru.moved(self.filter)

    def error_dps(self) -> Floats:
        return np.degrees(self.filter.state.bias - BIAS)


# ---- a rest -------------------------------------------------------------------------------------------------------


def test_a_rest_measures_the_bias_with_the_noise_of_its_mean() -> None:
    rest = Rest()
    receipts = rest.lives(20.0)
    assert len(receipts) == 19, "but the latest, which may be the last"
    assert all(r.accepted and r.kind == "zaru" for r in receipts)
    own = np.radians(0.03) ** 2 / N + MOTION**2
    then = rest.filter.state.bias_cov
    (late,) = rest.lives(1.0)
    np.testing.assert_allclose(np.diag(late.innovation_cov), np.diag(then + own), rtol=0.01)


def test_the_first_seconds_of_quiet_are_no_proof_of_rest() -> None:
    knobs = BiasKnobs()
    rest = Rest()
    rest.filter = BiasFilter(start(BIAS, np.radians(5.0) ** 2 * np.eye(3), 0.0, knobs), knobs)
    receipts = rest.lives(8.0)
    assert [r.reason for r in receipts] == [UNPROVEN] * 3 + [""] * 4
    assert receipts[0].innovation_cov[0, 0] > UNPROVEN_STD**2
    assert receipts[PROVEN_AFTER].innovation_cov[0, 0] < UNPROVEN_STD**2
    sure = Rest()
    assert sure.lives(3.0) == [], "who knows better waits for the proof"


# ---- slow turns ---------------------------------------------------------------------------------------------------


def turned(rate_dps: float, axis: int, noise_dps: float, seed: int) -> Stream:
    """A minute's rest on a table, a minute's even turn about an axis, the z axis up, and rest."""
    pieces: list[Piece] = [Still(60.0), Spin(60.0, np.eye(3)[axis], np.radians(rate_dps), 1.0), Still(10.0)]
    return stream(pieces, 130.0, seed=seed, spec=replace(PLAIN, noise_dps=noise_dps), attitude=LEVEL)


def way_deg(of: Stream, axis: int, *, accel: bool) -> float:
    """How far it turned within the minute by readings corrected as they came."""
    worn = Worn.new(of.bias[0], 0.02).lives(of, accel=accel)
    here = slice(of.at(60.0), of.at(120.0))
    return float(np.degrees((of.gyro - worn.at(of.time))[here, axis].sum() / of.rate_hz))


@pytest.mark.parametrize("accel", [True, False], ids=["aided", "gyro only"])
@pytest.mark.parametrize("axis", [0, 2], ids=["tilting", "level"])
@pytest.mark.parametrize("rate_dps", [0.1, 0.3, 1.0, 2.0])
def test_of_a_slow_turn_99_percent_is_kept(rate_dps: float, axis: int, accel: bool) -> None:
    kept = [way_deg(turned(rate_dps, axis, 0.03, seed), axis, accel=accel) / (59.0 * rate_dps) for seed in range(4)]
    assert np.mean(kept) > 0.99
    # What noise leaves in the bias, 1e-3 °/s or so, is there without a turn as well.
    assert min(kept) > 0.99 - 1e-3 / rate_dps


@pytest.mark.parametrize("accel", [True, False], ids=["aided", "gyro only"])
@pytest.mark.parametrize(("rate_dps", "axis"), [(0.3, 2), (1.0, 2), (0.3, 0)])
def test_a_noisier_gyro_swallows_no_more(rate_dps: float, axis: int, accel: bool) -> None:
    kept = []
    for seed in range(4):
        moved, same = (way_deg(turned(rate, axis, 0.15, seed), axis, accel=accel) for rate in (rate_dps, 0.0))
        kept.append((moved - same) / (59.0 * rate_dps))
    assert np.mean(kept) > 0.98
    assert min(kept) > 0.95


# ---- a bias that moves --------------------------------------------------------------------------------------------


def jumped(dps: Floats, seconds: float) -> Stream:
    """At rest all the time; after 40 s the bias jumps."""
    of = rest(40.0 + seconds, seed=3)
    jump = np.where((of.time > 40.0)[:, None], np.radians(dps), 0.0)
    return replace(of, gyro=of.gyro + jump, bias=of.bias + jump)


def test_a_jump_across_gravity_is_learnt_within_seconds() -> None:
    of = jumped(np.array([0.5, 0.0, 0.0]), 20.0)
    worn = Worn.new().lives(of)
    assert abs(worn.error_dps(of)[0]) < 0.01
    assert any(r.reason == "jumped" for r in worn.receipts)


def test_a_jump_along_gravity_waits_until_it_insists() -> None:
    early, late = (jumped(np.array([0.0, 0.0, 0.5]), INSIST_S + s) for s in (-5.0, 15.0))
    waiting, learnt = (Worn.new().lives(of) for of in (early, late))
    assert waiting.error_dps(early)[2] == pytest.approx(-0.5, abs=0.01)
    assert abs(learnt.error_dps(late)[2]) < 0.01
    assert any(r.reason == "insisted" for r in learnt.receipts)


def with_holes(of: Stream, *holes: tuple[float, float]) -> Worn:
    """Lived but for what is lost, from and to s."""
    worn, begin = Worn.new(), 0
    for since, until in holes:
        worn.lives(of.part(begin, int(np.searchsorted(of.time, since))))
        begin = int(np.searchsorted(of.time, until))
    return worn.lives(of.part(begin, len(of)))


def test_holes_keep_no_contradiction_from_being_believed_but_lengthen_it() -> None:
    of = jumped(np.array([0.0, 0.0, 0.5]), INSIST_S + 40.0)
    holed = with_holes(of, *((s, s + 0.4) for s in (70.0, 100.0, 130.0)))
    assert any(r.reason == "insisted" for r in holed.receipts)
    assert abs(holed.error_dps(of)[2]) < 0.01
    late = with_holes(of, (60.0, 130.0))
    assert not any(r.reason == "insisted" for r in late.receipts), "nobody saw it rest meanwhile"


def test_a_bed_that_turns_evenly_for_nearly_two_minutes_teaches_nothing() -> None:
    rest = Rest()
    rest.lives(30.0)
    assert not any(r.accepted and r.reason != UNPROVEN for r in rest.lives(115.0, 0.5))
    rest.lives(20.0)
    np.testing.assert_allclose(rest.error_dps(), 0.0, atol=0.02)


# ---- tilting ------------------------------------------------------------------------------------------------------


def test_while_gravity_turns_no_rest_is_believed() -> None:
    rest = Rest(up=UP)
    rest.lives(20.0)
    before = rest.filter.state.bias
    rate = np.radians(0.5)
    receipts = []
    for i, second in enumerate(rest.seconds(30.0, rate * np.eye(3)[0])):
        angle = rate * (i + 0.5)
        pulled = 9.81 * np.array([0.0, np.sin(angle), np.cos(angle)])
        rest.up = pulled / 9.81
        receipts += rest.take(second._replace(accel_mean=pulled))
    assert {r.reason for r in receipts[6:] if r.kind == "zaru"} == {REFUSED_TILT}
    assert np.degrees(np.abs(rest.filter.state.bias - before)).max() < 0.01
    # And when gravity stays, it is a rest again.
    assert rest.lives(SETTLED_S + OVER_S + 10.0)[-1].accepted


@pytest.mark.parametrize("waits", [0, 1, 3, 8])
@pytest.mark.parametrize("now", [True, False])
def test_late_evidence_is_worth_what_all_evidence_at_once_is(waits: int, *, now: bool) -> None:
    """Against all at once: the walks and what was measured as one Gaussian. The latest seconds wait."""
    knobs, steps, along = BiasKnobs(), 12, np.array([[0.1, 0.2, 1.0]]) / np.sqrt(1.05)
    P0, R, now_R = np.radians(0.02) ** 2, np.radians(0.006) ** 2, np.radians(0.004) ** 2
    # The first bias, and the walk of each step.
    prior, ends = np.diag([P0, *[knobs.rate_random_walk**2] * steps]), np.tri(steps, 1 + steps, 1)
    bias = BiasFilter(start(np.zeros(3), P0 * np.eye(3), 0.0, knobs), knobs)
    waiting: list[tuple[Evidence, float, float]] = []
    for time in np.arange(1.0, 1.0 + steps):
        bias.predict(time)
        if now:
            bias.update(Evidence("now", np.zeros(2), np.eye(2, OWN), now_R * np.eye(2), np.inf))
        waiting.append(
            (Evidence("late", np.zeros(1), np.pad(along, ((0, 0), (0, 3))), R * np.eye(1), np.inf), time, np.nan)
        )
        while len(waiting) > waits:
            bias.update_late(*waiting.pop(0))
    for late in waiting:
        bias.update_late(*late)
    seen, var = np.kron(ends, along), np.full(steps, R)
    if now:
        seen, var = np.vstack([seen, np.kron(ends, np.eye(2, 3))]), np.append(var, np.full(2 * steps, now_R))
    before, last = np.kron(prior, np.eye(3)), np.kron(ends[-1], np.eye(3))
    S = seen @ before @ seen.T + np.diag(var)
    least = last @ before @ last.T - last @ before @ seen.T @ np.linalg.solve(S, seen @ before @ last.T)
    ratio = np.sqrt(np.linalg.eigvals(np.linalg.solve(least, bias.cov[:3, :3])).real)
    assert 0.95 < ratio.min() <= ratio.max() < 1.05

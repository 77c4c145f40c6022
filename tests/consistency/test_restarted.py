"""A restart of the estimator is no reason to doubt who wears the device and breathes."""

from dataclasses import replace

import numpy as np

from estimator.device.prior_knowledge import PriorKnowledge
from estimator.device.session import DeviceSession
from estimator.offline.recorded_batches import batches
from estimator.tracking.bias_state import BiasKnobs, start
from tests.consistency.test_warming import recording
from tests.estimator.device.test_correction import CALIBRATION
from tests.estimator.stream import handle
from tests.sim.day import simulate_day

_EVERY_S = 100.0


def doubts(seed: int) -> tuple[int, list[str]]:
    """How often it was restarted in an hour, and what was doubted."""
    day = simulate_day(seed, 1.0, 52.0)
    of = recording(day, temperature=True, accel=True)
    at = round(45 * of.rate_hz)
    known, cov = day.bias[at].astype(float), np.radians(0.01) ** 2 * np.eye(3)
    made = replace(CALIBRATION, device="recorded", matrix=day.truth.matrix, bias=known, rate_hz=of.rate_hz)
    begun = start(
        known, cov, float(of.time_s[at]), BiasKnobs(), temperature_c=float(day.temperature_c[at]), powered=0.0
    )
    kept, restarts, said = PriorKnowledge(made, begun), 0, list[str]()
    session: DeviceSession | None = None
    begins_s = float(of.time_s[at])
    for batch in batches(of, 0.0, round(of.rate_hz)):
        now = float(batch.device_time[0])
        if now < of.time_s[at]:
            continue
        if session is None or now >= begins_s + _EVERY_S:
            if session is not None:
                kept = PriorKnowledge(made, session.checkpoint(), doubted=session.tracker.doubt.stands)
                restarts += 1
            session, begins_s = DeviceSession("recorded"), now
            session.begin_boot(1, now, kept, None, float(day.temperature_c[round(now * of.rate_hz)]))
        said += handle(session, batch).said
    return restarts, [words for words in said if "DEGRADED: rests disagree" in words]


def test_a_breath_after_a_restart_is_no_rest_that_disagrees() -> None:
    found = [doubts(seed) for seed in (60, 61)]
    assert sum(restarts for restarts, _ in found) > 60
    assert sum(len(said) for _, said in found) <= 1, "17 % of them, by the first quiet second alone"

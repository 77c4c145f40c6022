"""A device calibrates itself with the C program and sends the result in the native protocol: the ward uses it."""

from pathlib import Path

import numpy as np
import pytest

from bridge.sim.motion import Still
from bridge.wire.messages import Quality, State, Verdict
from estimator.client import Client
from estimator.demo.subscribers import Watcher
from estimator.demo.ward import WARD, Ward
from estimator.device.own_calibration import METHOD
from estimator.device.session import OWN_REFUSED
from tests.embedded.host_program import OK, counted, run
from tests.estimator.device.session.lives import worn
from tests.estimator.stream import Stream, calibration
from tests.sentences import codes
from tests.ward.parts import recorded, subscribers, wait

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward 2"), pytest.mark.timeout(180)]
SPEED = 10.0


def lives() -> tuple[Stream, Stream]:
    """A device that is turned at home, and then worn on the ward: 12 s at rest, and moved and at rest by turns."""
    of = calibration(seed=3, after=[Still(12.0), *worn(3)])  # type: ignore[list-item]
    ward = len(of) - round(54.0 * of.rate_hz)
    return of.part(0, ward), of.part(ward, len(of))


def test_the_ward_uses_a_device_s_own_calibration(program: Path, tmp_path: Path) -> None:
    home, ward_life = lives()
    found = run(program, counted(home.gyro), home.rate_hz)
    assert found.status == OK
    sent = {
        "right": (found.k, found.bias),
        "doubled": (2 * found.k, found.bias),
        "degrees": (found.k, np.degrees(found.bias) + 1.0),
        "elsewhere": (found.k, found.bias + np.radians(3.0)),
        "unfinite": (found.k * np.nan, found.bias),
    }
    devices = {
        name: recorded(name, ward_life.gyro, ward_life.accel, ward_life.rate_hz, ward_life.temperature_c)
        for name in sent
    }
    with Ward(tmp_path, tuple(sent)) as ward:
        ward.start("router", "estimator", "bridge")
        ward.wait_for_router()
        [heard], watcher = subscribers(ward, 1), Watcher(ward.endpoint, WARD)
        # "elsewhere" sends its own once rests have shown its bias; the others from the start.
        for name in set(sent) - {"elsewhere"}:
            devices[name].calibrates_itself(*sent[name])
        for name, device in devices.items():
            ward.plug(name, device, speed=SPEED, lossless=True)
        try:
            wait("a rest", lambda: sees(watcher, "elsewhere", State.BIAS_ONLY), watcher, ward)
            devices["elsewhere"].calibrates_itself(*sent["elsewhere"])
            n = len(ward_life)
            wait("all samples", lambda: min(heard.received.values()) >= n and len(heard.received) == 5, watcher, ward)
            wait("the last status", lambda: watcher.statuses["right"].samples_out >= n, watcher, ward)
            refused = {"doubled", "degrees", "elsewhere"}
            wait("refusals", lambda: all(watcher.statuses[d].events.get(OWN_REFUSED) for d in refused), watcher, ward)
            with Client((ward.endpoint,), ward=WARD) as client:
                published = {name: client.calibrations(name) for name in sent}
        finally:
            heard.close()
            watcher.close()
    batches = {device: found for (device, _), found in heard.batches.items()}
    for name in set(sent) - {"right"}:
        assert not {b.quality for b in batches[name]} & {Quality.GOOD, Quality.DEGRADED}, name
        assert not watcher.statuses[name].calibration
    assert [(c.method, c.verdict, codes(c.reason)) for c in published["right"]] == [
        (METHOD, Verdict.ACCEPTED, ["own_accepted"])
    ]
    why = {
        name: [(c.verdict, c.reason[0].code) for c in published[name]] for name in ("doubled", "degrees", "elsewhere")
    }
    assert why == {
        "doubled": [(Verdict.REFUSED, "scale_outside")],
        "degrees": [(Verdict.REFUSED, "own_bias_large")],
        "elsewhere": [(Verdict.REFUSED, "own_bias_contradicted")],
    }
    assert published["unfinite"] == []
    status = watcher.statuses["right"]
    assert (status.state, status.quality, status.calibration) == (
        State.TRACKING,
        Quality.GOOD,
        published["right"][0].id,
    )
    good = [b for b in batches["right"] if b.quality is Quality.GOOD]
    assert sum(map(len, good)) > 0.7 * n
    errors = np.concatenate([(b.rate - ward_life.rate[b.sequence : b.sequence + len(b)]) / b.rate_std for b in good])
    assert np.sqrt(np.square(errors).mean()) < 1.1
    assert np.abs(errors).max() < 5.5


def sees(watcher: Watcher, device: str, state: State) -> bool:
    return device in watcher.statuses and watcher.statuses[device].state is state

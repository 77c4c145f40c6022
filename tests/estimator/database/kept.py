"""A small store with something in every table, and what may be loaded of it: exactly that, or less of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from bridge.wire import codec
from estimator.service.store import Store
from estimator.tracking.bias_state import BiasState
from tests.estimator.device.test_correction import CALIBRATION
from tests.estimator.stream import NAME, info
from tests.sentences import free

CALIBRATIONS = [
    replace(CALIBRATION, id=f"c{n}", boot=n, time_ns=n, model="m", firmware="1.0", gyro_range=8.7, rate_hz=104.0)
    for n in (1, 2, 3)
]


def bias(n: int) -> BiasState:
    x = np.concatenate([np.array([0.1, -0.2, 0.3]) * n, np.zeros(3)])
    return BiasState(x, np.diag([1e-8, 2e-8, 3e-8, 1e-12, 1e-12, 1e-12]), float(n), 20.0 + n)


def fill(store: Store) -> None:
    for n, calibration in enumerate(CALIBRATIONS, 1):
        store.add_boot(info(n), n)
        store.add_calibration(calibration)
        for minute in range(6):
            store.save_bias(NAME, n, 10 * n + minute, bias(n + minute), history=True)
    store.add_audit(5, NAME, "recalibrate", "r1", "nurse", "strap", free("done"), accepted=True)
    store.add_audit(6, NAME, "cancel", "r2", "nurse", "", free("nothing to cancel"), accepted=False)


def made(folder: Path) -> Path:
    path = folder / "a.sqlite3"
    store = Store(path)
    fill(store)
    store.close()
    return path


def loaded(store: Store) -> set[object]:
    """All that a service can have of it, as things that can be compared."""
    things: set[object] = {("calibration", codec.encode_calibration(c)) for c in store.calibrations(NAME)}
    for boot in (1, 2, 3, 4):
        remembered = store.recall(NAME, boot, 100)
        if remembered is not None and remembered.calibration is not None:
            things.add(("recalled", boot, codec.encode_calibration(remembered.calibration)))
            if remembered.bias is not None:
                state = remembered.bias
                numbers = (*state.x.tolist(), *state.P.ravel().tolist(), state.time, state.temperature_c)
                things.add(("bias", boot, remembered.age_s, numbers))
    for this in (2, 9):
        prior = store.prior(info(this))
        things.add(("prior", this, None if prior is None else codec.encode_calibration(prior)))
        for points in store.points(info(this)):
            rows = zip(points.time, points.bias.tolist(), points.std.tolist(), points.temperature_c, strict=True)
            things |= {("point", this, time, *value, *std, celsius) for time, value, std, celsius in rows}
    for verb, request in (("recalibrate", "r1"), ("cancel", "r2"), ("cancel", "r1")):
        things.add(("answer", verb, request, repr(store.answer(NAME, verb, request))))
    return things

"""Lookup of a device's earlier boots: calibrations and biases in the store and in other estimators' checkpoints."""

import logging
from collections.abc import Callable

import numpy as np

from bridge.reasons.codes import Sentences
from bridge.wire.messages import Calibration, DeviceInfo
from estimator.device.restore_key import changed, differing, restore_key
from estimator.device.session import DeviceSession
from estimator.geometry.gyro_model import repeatability
from estimator.service.checkpoints import Checkpoints
from estimator.service.device import Device
from estimator.service.store import Store
from estimator.service.store_writer import StoreWriter
from estimator.tracking.temperature_law import TemperatureLaw
from estimator.tracking.temperature_learning import learn

log = logging.getLogger(__name__)

#: boots of a device that are recognised after a restart
BOOTS_KNOWN = 48
#: a calibration dated this far ahead of now shows that the clock was wrong then, or is wrong now, s
AHEAD_S = 60.0


class EarlierBoots:
    """Lookup of a device's earlier boots, in the store and in other estimators' checkpoints.

    clerk: the store's thread. now_ns: the host's clock, ns since the Unix epoch. pending(device): calibrations of a
    device that are not on disk yet.
    """

    def __init__(
        self,
        store: Store,
        replicas: Checkpoints,
        clerk: StoreWriter,
        now_ns: Callable[[], int],
        pending: Callable[[str], list[Calibration]],
    ) -> None:
        self._store, self._replicas, self._clerk = store, replicas, clerk
        self._now_ns, self._pending = now_ns, pending

    def prior(self, device: Device, info: DeviceInfo) -> Calibration | None:
        """Return the latest calibration of the same hardware in an earlier boot, stored or still pending, or None.

        info: of the present boot. Device, model, firmware and range must match; for a device without a clock also the
        rate. A calibration dated in the future is logged.
        """
        for pending in reversed(self._pending(device.name)):
            if pending.boot != info.boot and not differing(restore_key(pending), info):
                return pending
        now_ns = self._now_ns()
        found = [c for c in (self._replicas.prior(info), self._store.prior(info)) if c is not None]
        return self._dated(device, max(found, key=lambda c: (c.time_ns <= now_ns, c.time_ns), default=None))

    def _dated(self, device: Device, c: Calibration | None) -> Calibration | None:
        """Pass a calibration through; logs a warning if its time lies in the future."""
        ahead_s = 0.0 if c is None else (c.time_ns - self._now_ns()) / 1e9
        if c is not None and ahead_s > AHEAD_S and device.session.count_event("calibration dated in the future") == 1:
            words = (
                "calibration %s is dated %.1f days in the future: this machine's clock was wrong then, or is wrong now"
            )
            log.warning(f"%s: {words}", device.name, c.id, ahead_s / 86400)
        return c

    def scratch(self, info: DeviceInfo) -> Sentences:
        """Return the reasons why this device's latest stored calibration does not apply.

        Empty if it applies or none exists.
        """
        latest = self._store.latest(info.device)
        return () if latest is None else changed(latest, info, within_boot=latest.boot == info.boot)

    def law(self, session: DeviceSession, info: DeviceInfo, then: Callable[[TemperatureLaw | None], None]) -> None:
        """Fit the temperature law (bias against temperature) to earlier boots of the same hardware.

        session: its settings of the bias filter are used. info: hardware of the device.
        then(law): called on the service's thread; law is None if there is none. The fit runs on the store's thread,
        since it may take long.
        """
        knobs = session.knobs.track.bias
        self._clerk.look_up(lambda: learn(self._store.points(info), knobs), then)

    def moves(self, session: DeviceSession, info: DeviceInfo, then: Callable[[float], None]) -> None:
        """Compute the relative standard deviation of the scale factors' change from boot to boot of the same hardware.

        session: its settings of the prior are used. info: hardware of the device.
        then(std): called on the service's thread. The store is read on its own thread.
        """

        def moved() -> float:
            return repeatability([np.diag(c.matrix) for c in self._store.earlier(info)], session.knobs.prior)

        self._clerk.look_up(moved, then)

    def past(self, device: str) -> list[int] | None:
        """Return the boot ids of a device from before this estimator started, oldest first, at most BOOTS_KNOWN.

        None if the store cannot be read.
        """
        boots = self._store.boots(device, BOOTS_KNOWN)
        return None if self._store.database.trouble and not boots else boots

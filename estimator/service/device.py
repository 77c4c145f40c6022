"""Device in the service: its session, admission of its messages, and its publishers."""

import math
import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from bridge.bus.contract import Bus, Publisher
from bridge.wire import codec, keys
from bridge.wire.batches import CorrectedEncoder
from bridge.wire.messages import Alert, BiasRevision, Checkpoint, Placement, State, Status
from bridge.wire.orientation import encode_columns
from estimator.alerts.board import Board, Change
from estimator.config.alerts import DEFAULTS, Alerts
from estimator.device.admission import Admission
from estimator.device.attention import attentions, ended
from estimator.device.batch_correction import Cut, Rates
from estimator.device.correction import Correction
from estimator.device.orientation import OrientedCut
from estimator.device.session import DeviceSession
from estimator.device.session_knobs import SessionKnobs
from estimator.service import output

#: messages cached for late and returning subscribers; for corrected, a bridge's cache of 50 ms batches and some more
CACHES = {"corrected": 640, "status": 1, "calibration": 8, "revision": 8, "note": 8, "checkpoint": 1}
CACHES |= {"orientation": 0, "@windowed": 0}  # live only, and made only while somebody subscribes
#: kept open for a time after a takeover: rates, the calibrations they name, and checkpoints for a cut-off estimator
_ASKED_FOR = "corrected", "calibration", "checkpoint"
#: a newcomer that no list names is announced once it has lived for so long, device s: its publishers cost much
NEWCOMER_S = 2.0
#: the first checkpoint is due after this time, s; until then the former owner's checkpoint still serves
FIRST_CHECKPOINT_S = 1.0
#: silence after which the status states how old its information is, s
SILENT_S = 2.0
#: s without a subscriber after which the orientation is given up; who comes back earlier finds the same heading
FORGET_ORIENTATION_S = 10


class Device:
    """Session and publishers of one device; after a failure in the session, `restart` begins a new one.

    silence_s: silence after which the device counts as lost, s. now: monotonic time, s. began: device time at the start
    of the boot, s.
    epoch: number of this estimator's ownership; rises with each takeover. troubles: event counts of the whole
    estimator, which every status includes.
    """

    def __init__(
        self,
        bus: Bus,
        ward: str,
        name: str,
        knobs: SessionKnobs,
        silence_s: float,
        now: float,
        epoch: int = 0,
        began: float = 0.0,
        alerts: Alerts = DEFAULTS,
        troubles: Mapping[str, int] = MappingProxyType({}),
    ) -> None:
        self.name, self._troubles = name, troubles
        self._alerts = alerts
        #: alerts of this device
        self.board = Board(alerts)
        #: epoch of this estimator's ownership, in every message about the device
        self.epoch = epoch
        #: decides which messages are accepted; `key` is the bus key of the samples
        self.admission = Admission(silence_s)
        self.key = ""
        #: time of the last sign of life, monotonic s
        self.heard = now
        #: time of the next checkpoint: early, so that repeated kills do not accumulate work, but not immediately
        self.checkpoint_due, self.recorded = now + FIRST_CHECKPOINT_S, 0.0
        #: encoded calibrations to be published once stored; messages that refer to them wait in `_held`
        self._unsaid: dict[str, bytes] = {}
        self._held: list[bytes] = []
        #: device s after which the device is announced: NEWCOMER_S where neither a list nor the store knows it, else 0
        self.announced_after_s = 0.0
        self._first_s = math.inf  # device time of the first sample of a device that is not announced
        self._told = ""  # id of the calibration published last
        #: where and by whom the device is worn; None if nobody said
        self.placement: Placement | None = None
        #: the status published last
        self.latest: Status | None = None
        self._delay_s: float | None = None  # latency of the first publication since `delay` was called
        self._bus, self._ward, self._knobs = bus, ward, knobs
        self.session = DeviceSession(name, knobs, began, self.admission.sequence)
        #: boot number that another power-up had before, until this power-up is calibrated
        self.repeated: int | None = None
        #: samples that came from the device's own bridge; corrected samples published, or to be published in this round
        self.came = self.told = 0
        self._gone = False
        self._publishers: dict[str, Publisher] = {}
        self._unwanted_s = 0  # s for which nobody has subscribed to the orientation
        self._encoder = CorrectedEncoder(name, epoch)
        self._correction: Correction | None = None  # correction of the last encoded samples

    @property
    def announced(self) -> bool:
        """True if the device's messages are published.

        Messages of a newcomer (a device in neither the ward file nor the store) are published only after NEWCOMER_S
        seconds of device time.
        """
        return not self._gone and not self.announced_after_s

    @property
    def worthless(self) -> bool:
        """True if the device can be forgotten without loss: no calibration of this boot or an earlier one is known."""
        return self.session.calibration is None and self.session.prior is None

    def say(self, what: str, payload: bytes) -> None:
        """Publish an encoded message of the device if the device is announced.

        what: kind of the message, such as `status` or `calibration`; the keys of CACHES list all kinds.
        """
        if self.announced:
            self._publisher(what).put(payload)

    def say_corrected(self, cut: Cut, rates: Rates) -> None:
        """Publish corrected samples, or hold them back until the device is announced and its calibration stored.

        cut: segment of a sample message, with its correction. rates: packed corrected rates (n, 3), rad/s, and flags.
        """
        if (correction := cut.correction) is not self._correction:
            self._correction = correction
            self._encoder.corrected_by(correction.quality, correction.calibration, correction.told)
        self._held.append(self._encoder.encode(*cut.header, *rates))
        if not self.announced:
            self._first_s = min(self._first_s, cut.samples.first_s)
            if cut.samples.last_s - self._first_s >= self.announced_after_s:
                self.announced_after_s = 0.0
        self._say_held()
        if self._delay_s is None:
            self._delay_s = (time.time_ns() - self.session.last_heard_ns) / 1e9

    def say_orientation(self, one: OrientedCut) -> None:
        """Publish the attitudes of a segment of corrected samples, if anybody subscribes to orientation."""
        if self._unwanted_s:
            return
        cut, (quat_wxyz, accel, cov), zero = one
        quat, cov_of_last = quat_wxyz.astype(np.float32).tobytes(), cov[-1].astype(np.float32).tobytes()
        packed = quat, output.linear_accel(accel), cov_of_last
        payload = encode_columns(self.name, self.epoch, cut.header, *packed, zero, cut.correction.quality)
        self.say("orientation", payload)

    def look_round(self) -> None:
        """Switch window summaries and orientation on or off, as subscribers need them; called once a second."""
        oriented = self._is_wanted("orientation")
        self._unwanted_s = 0 if oriented else self._unwanted_s + 1
        if oriented and self.session.attitude is None:
            self.session.orient()
        elif self._unwanted_s > FORGET_ORIENTATION_S:
            self.session.attitude = None
        self.session.windowed = self._is_wanted("@windowed")

    def stands(self, standing: Iterable[Alert], now: float) -> None:
        """Replace the device's alerts by those that were raised before a restart or a takeover.

        standing: alerts that have not ended. now: monotonic time, s.
        """
        self.board = Board(self._alerts, standing, now)

    def look_for_alerts(self, now: float, time_ns: int) -> list[Change]:
        """Raise and clear the device's alerts; returns the changes.

        now: monotonic time, s. time_ns: host time, ns since the Unix epoch. Empty while the device is not announced, or
        its state is unknown.
        """
        if not self.announced or self.session.life.state is State.UNKNOWN:
            return []
        return self.board.look(
            attentions(self.session.life.state, self.session.life.reason, self.session.info), now, time_ns
        )

    def say_status(self, time_ns: int) -> None:
        """Publish the present status and keep it in `latest`; does nothing while a calibration waits to be stored.

        time_ns: host time, ns since the Unix epoch.
        """
        if not self._unsaid:
            self.latest = self.status(time_ns)
            self.say("status", codec.encode_status(self.latest))
            self._say_known()

    def say_calibration(self, calibration: str, payload: bytes) -> None:
        """Publish an encoded calibration. calibration: its id."""
        self._told = calibration
        self.say("calibration", payload)

    def hold(self, calibration: str, payload: bytes) -> None:
        """Hold back corrected rates until their calibration is stored, so that subscribers can look it up.

        calibration: its id. payload: the encoded calibration, which `let_go` publishes.
        """
        self._unsaid[calibration] = payload

    def let_go(self, calibration: str) -> bool:
        """Publish a calibration held back by `hold`, then the rates that waited for it.

        Returns whether a calibration of this id was held.
        """
        payload = self._unsaid.pop(calibration, None)
        if payload is None:
            return False
        self.say_calibration(calibration, payload)
        self._say_held()
        return True

    def _say_held(self) -> None:
        if self.announced and not self._unsaid:
            held, self._held = self._held, []
            for payload in held:
                self.say("corrected", payload)

    def _say_unsaid(self) -> None:
        """Publish everything that waits for the disk."""
        for calibration in list(self._unsaid):
            self.let_go(calibration)

    def _say_known(self) -> None:
        """Publish the calibration in use if a former owner published it, so that new subscribers can look it up."""
        known = self.session.calibration or self.session.prior
        if known is not None and known.id != self._told and known.id not in self._unsaid:
            self.say_calibration(known.id, codec.encode_calibration(replace(known, epoch=self.epoch)))

    def say_revision(self, revision: BiasRevision) -> None:
        """Publish a revision of past biases; does nothing if `output.revision` leaves too few points."""
        fit = output.revision(revision)
        if fit is not None:
            self.say("revision", codec.encode_revision(fit))

    def status(self, time_ns: int) -> Status:
        """Build the complete status message of the device, every number within the limits of the wire format.

        time_ns: host time, ns since the Unix epoch.
        """
        now = time.monotonic()
        silent_s = now - self.heard if now - self.heard > SILENT_S else 0.0
        said = self.session.status(
            time_ns,
            bridge=self.admission.owner,
            refused_bridges=self.admission.refused(now),
            epoch=self.epoch,
            silent_s=silent_s,
            more=[(event, n) for event, n in self._troubles.items() if n],
            placement=self.placement,
            alerts=self.board.standing,
        )
        return output.status(said)

    def delay(self) -> float:
        """Return the seconds from receipt to publication of the first sample published since the last call.

        NaN if no sample was published.
        """
        delay_s, self._delay_s = self._delay_s, None
        return math.nan if delay_s is None else delay_s

    def use(self, knobs: SessionKnobs, alerts: Alerts | None = None) -> None:
        """Apply changed settings: of alerts at once, of the session from the next boot or calibration on.

        knobs: settings of the session. alerts: settings of the alerts; None keeps the present ones.
        """
        self._knobs = self.session.knobs = knobs
        self._alerts = self.board.settings = alerts or self._alerts

    @property
    def ended(self) -> bool:
        """True if the device is away and is not expected to send again, for example after the end of a recording."""
        return self.session.life.away and ended(self.session.life.reason)

    def restart(self) -> None:
        """Start a new session after a failure; the next batch with new samples begins a boot in it.

        Samples that were received and not published count as dropped.
        """
        sequence = self.admission.restart(self.came, self.told, self.session.last_heard_ns)
        self.session = DeviceSession(self.name, self._knobs, sequence=sequence)

    def take_over(self, known: Checkpoint) -> None:
        """Continue the session from a checkpoint.

        Raises ValueError if the checkpoint's state is invalid; the device is then unchanged.
        """
        self.session = DeviceSession.restored(
            known.state, known.calibration, self.name, self._knobs, self.admission.sequence
        )
        self.repeated = known.boot if known.boot_repeated else None
        self.admission.go_on(self.session.last_heard_ns)

    def leave(self) -> list[Publisher]:
        """Close the publishers of a device that another estimator took; returns the publishers that stay open.

        Publishers of rates, calibrations and checkpoints stay open for late queries; the caller closes them later.
        """
        self._say_unsaid()
        kept = [self._publishers.pop(what) for what in _ASKED_FOR if what in self._publishers]
        self.close()
        self._gone = True
        return kept

    def close(self) -> None:
        """Publish the messages that wait for the disk, and close all publishers."""
        self._say_unsaid()
        for publisher in self._publishers.values():
            publisher.close()
        self._publishers = {}

    def _is_wanted(self, what: str) -> bool:
        return self.announced and self._publisher(what).wanted

    def _publisher(self, what: str) -> Publisher:
        """Publisher, declared on first use to keep a takeover fast."""
        if (publisher := self._publishers.get(what)) is None:
            key = keys.build(self._ward, what, device=self.name)
            publisher = self._publishers[what] = self._bus.publisher(key, cache=CACHES[what])
        return publisher

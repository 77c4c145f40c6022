"""Estimator store of a ward: calibrations, boots, biases, placements, alerts, and an audit of commands.

Calibrations are appended and never changed. Of each boot only the latest bias is kept. Old boots and old points of the
bias history are thinned by the rules of `retention`.
"""

from collections import Counter
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

import msgspec

from bridge.reasons.codes import Code, Sentences
from bridge.wire import codec, keys
from bridge.wire.messages import Alert, BootCause, Calibration, DeviceInfo, Placement, Verdict
from estimator.database import Database, Row
from estimator.device.restore_key import restore_key
from estimator.service.retention import THIN
from estimator.service.store_reader import REPEATED, StoreReader
from estimator.service.store_rows import (
    Kept,
    repeat_request,
    written,
)
from estimator.tracking.bias_state import OWN, BiasState

#: on a repeated boot, only unknown properties of its device are filled in
_FILLED = ", ".join(f"{name} = iif({name}, {name}, excluded.{name})" for name in ("gyro_range", "rate_hz"))
_FILLED += "".join(f", {name} = iif({name} = '', excluded.{name}, {name})" for name in ("model", "firmware"))
_ONE_OF_BOOT = "ON CONFLICT (device, boot) DO UPDATE SET"

#: read once: an installation beside the running program must not change what it writes
_VERSION = version("truerate")


class Store(StoreReader):
    """Open store of a ward's devices, for reading and writing.

    path: the file, or an open Database. patient: True raises no error for an unreadable file; queries then return no
    rows.
    Only the writing thread may call `add_…`, `save_…`, `repeat`, `erase` and `thin`; any thread may call the rest.
    Writing methods raise StoreError if the write fails.
    """

    def __init__(self, path: Path | str | Database, *, patient: bool = False) -> None:
        super().__init__(path if isinstance(path, Database) else Database(path, patient=patient))

    def add_calibration(self, c: Calibration) -> None:
        """Append an accepted calibration; a known id changes nothing.

        Raises ValueError if its verdict is not ACCEPTED.
        """
        if c.verdict is not Verdict.ACCEPTED:
            raise ValueError(f"the calibration has verdict {c.verdict.name}: only ACCEPTED calibrations can be stored")
        row: Row = {"id": c.id, "device": c.device, "boot": keys.boot_id(c.boot), "time_ns": c.time_ns}
        row |= {
            "method": c.method,
            "verdict": c.verdict.name,
            "reason": written(c.reason),
            "who": c.who,
            "version": _VERSION,
        }
        row |= restore_key(c) | {"payload": codec.encode_calibration(c)}
        self.database.insert("calibrations", row, "ON CONFLICT (id) DO NOTHING")

    def add_boot(self, info: DeviceInfo, time_ns: int) -> None:
        """Store a boot of a device with its settings; of a boot stored already, only unknown settings are filled in.

        The settings are model, firmware, range and rate. time_ns: host time, ns since the Unix epoch.
        """
        row: Row = {"device": info.device, "boot": keys.boot_id(info.boot), "time_ns": time_ns}
        row |= {"cause": BootCause(info.boot_cause).name, **restore_key(info)}
        self.database.insert("boots", row, f"{_ONE_OF_BOOT} {_FILLED}")

    def save_bias(
        self,
        device: str,
        boot: int,
        time_ns: int,
        state: BiasState,
        *,
        history: bool,
        doubted: bool = False,
        calibration: str = "",
        asked: tuple[str, str] | None = None,
        reached: tuple[int, int] | None = None,
        bridge: str = "",
        session: bytes = b"",
    ) -> None:
        """Store the latest bias of a boot for a restart; with `history` also as a point of the bias history.

        time_ns: host time, ns since the Unix epoch. state: bias in rad/s with covariance. doubted: whether the bias is
        in doubt.
        calibration: id of the calibration in use. asked: person who requested the recalibration in progress, and the
        reason.
        reached: sequence number and host time, ns since the Unix epoch, of the last sample used for the bias; None
        while turns of a calibration are in progress.
        bridge: id of the bridge whose samples are used. session: the whole session as bytes (DeviceSession.state), or
        empty.
        """
        # A restored tracker starts anew with all states except the filter's own.
        x, P = state.x[:OWN].tolist(), state.P[:OWN, :OWN].tolist()
        at = float(state.time), float(state.temperature_c), float(state.powered)
        kept = Kept(x, P, *at, float(state.lag_k), doubted, calibration, asked, reached, bridge, session)
        with self.database.transaction():
            self._save_state(device, boot, time_ns, msgspec.msgpack.encode(kept))
            if history:
                row: Row = {"device": device, "boot": keys.boot_id(boot), "time_ns": time_ns}
                for axis, name in enumerate("xyz"):
                    row |= {name: float(state.bias[axis]), f"{name}_std": float(state.std[axis])}
                celsius = float(state.temperature_c)  # SQLite stores NaN as NULL
                self.database.insert("bias_history", row | {"temperature_c": celsius})

    def save_epoch(self, epoch: int) -> None:
        """Store the highest known epoch, in place of the stored one.

        The epoch is the ownership number, which rises with each takeover.
        """
        row: Row = {"number": 1, "epoch": epoch}
        self.database.insert("epochs", row, "ON CONFLICT DO UPDATE SET epoch = excluded.epoch")

    def add_audit(
        self,
        time_ns: int,
        device: str,
        verb: str,
        request_id: str,
        who: str,
        reason: str,
        message: Sentences,
        *,
        accepted: bool,
    ) -> None:
        """Append to the audit: a command with its outcome, or a calibration that the estimator refused.

        time_ns: host time, ns since the Unix epoch. verb, request_id: of the command. who: the person. reason: given by
        the person. message: the reply. accepted: whether the command was accepted.
        """
        row: Row = {"time_ns": time_ns, "device": device, "verb": verb, "request_id": request_id, "who": who}
        self.database.insert("audit", row | {"reason": reason, "accepted": int(accepted), "message": written(message)})

    def add_placement(self, device: str, one: Placement) -> None:
        """Append a device's placement (where and by whom it is worn), which ends the previous placement.

        An empty placement means that nobody wears the device any more.
        """
        row: Row = {"device": device, "time_ns": one.since_ns, "segment": one.segment, "side": one.side}
        self.database.insert("placements", row | {"wearer": one.wearer, "who": one.who})

    def save_alert(self, device: str, one: Alert, time_ns: int, *, cleared: bool) -> None:
        """Store an alert when it is raised, acknowledged or ended. device: id of a device or an estimator.

        time_ns: host time of this change, ns since the Unix epoch. cleared: whether the alert has ended.
        """
        row: Row = {"device": device, "kind": one.kind, "since_ns": one.since_ns, "raised_ns": one.raised_ns}
        row |= {"acknowledged_ns": one.acknowledged_ns, "who": one.who, "time_ns": time_ns, "cleared": int(cleared)}
        changed = ", ".join(f"{name} = excluded.{name}" for name in ("acknowledged_ns", "who", "time_ns", "cleared"))
        self.database.insert("alerts", row, f"ON CONFLICT (device, kind, raised_ns) DO UPDATE SET {changed}")

    def repeat(self, device: str, boot: int, time_ns: int, made: Iterable[str] = ()) -> None:
        """Record that another power-up used this boot number before: stored calibrations and bias belong to that one.

        time_ns: host time, ns since the Unix epoch. made: ids of calibrations of the earlier power-up that are still to
        be written.
        """
        name = keys.boot_id(boot)
        message = written((Code.BOOT_NUMBER_REPEATED(),))
        with self.database.transaction():
            self.database.execute(
                "INSERT INTO audit (time_ns, device, verb, request_id, who, accepted, message, reason) SELECT ?, ?, ?, ?, ?, ?,"
                " ?, trim(? || ' ' || ifnull(group_concat(id, ' '), '')) FROM calibrations WHERE device = ? AND boot = ?",
                (
                    time_ns,
                    device,
                    REPEATED,
                    repeat_request(device, boot),
                    "estimator",
                    1,
                    message,
                    " ".join(made),
                    device,
                    name,
                ),
            )
            self._save_state(device, boot, time_ns, b"")

    def _save_state(self, device: str, boot: int, time_ns: int, state: bytes) -> None:
        row: Row = {"device": device, "boot": keys.boot_id(boot), "time_ns": time_ns, "state": state}
        filled = f"{_ONE_OF_BOOT} time_ns = excluded.time_ns, state = excluded.state"
        self.database.insert("bias", row, filled)

    def thin(self, device: str, now_ns: int) -> Counter[str]:
        """Delete the old rows of a device by the rules of `retention`; returns the number of deleted rows by table.

        now_ns: host time, ns since the Unix epoch.
        """
        deleted = Counter[str]()
        with self.database.transaction():
            for table, where in THIN:
                deleted[table] += self.database.execute(
                    f"DELETE FROM {table} WHERE {where}",  # noqa: S608 - our own words
                    {"device": device, "now_ns": now_ns},
                )
        return +deleted

    def erase(self, device: str) -> None:
        """Delete all stored entries of a device except its audit."""
        with self.database.transaction():
            for table in ("calibrations", "boots", "bias", "bias_history", "placements", "alerts"):
                self.database.execute(f"DELETE FROM {table} WHERE device = ?", (device,))  # noqa: S608 - our own words

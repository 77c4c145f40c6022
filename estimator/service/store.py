"""What the estimator keeps of a ward: calibrations, boots, biases and their history, and an audit of commands.

Calibrations are appended and never changed. Of a boot only the latest bias is kept; old boots and old points of the bias
history are thinned (`retention`).
"""

import logging
from collections.abc import Callable, Iterable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, Self

import msgspec
import numpy as np

from bridge.reasons.codes import Code, Sentences
from bridge.wire import codec, keys
from bridge.wire.messages import BootCause, Calibration, DeviceInfo, Verdict
from bridge.wire.refusal import Refusal
from estimator.database import Database, Row, StoreError
from estimator.device.prior_knowledge import PriorKnowledge
from estimator.device.restore_key import differing, restore_key
from estimator.service.retention import BOOTS, POINTS, THIN
from estimator.tracking.bias_filter import OWN, BiasState
from estimator.tracking.temperature_learning import Points

__all__ = ["BOOTS", "POINTS", "REPEATED", "Before", "Store", "StoreError"]

log = logging.getLogger(__name__)

#: the audit's verb for a boot number that another power-up had before
REPEATED = "boot number repeated"
#: the order in which rows were written, the latest first: a clock may have been wrong
_LATEST_FIRST = "number DESC"
#: how many calibrations of a device are looked at first: most often the latest is the one
_FEW = 8
#: a second boot of the same number keeps what was not known of its device
_FILLED = ", ".join(f"{name} = iif({name}, {name}, excluded.{name})" for name in ("gyro_range", "rate_hz"))
_FILLED += "".join(f", {name} = iif({name} = '', excluded.{name}, {name})" for name in ("model", "firmware"))
_ONE_OF_BOOT = "ON CONFLICT (device, boot) DO UPDATE SET"


class Before(NamedTuple):
    """Of calibrations under a boot number those of an earlier power-up, and when that was seen; None where it was not."""

    ids: frozenset[str]
    seen_ns: int | None

    def has(self, calibration: Calibration) -> bool:
        """Whether it is one of them, as far as one knows."""
        return calibration.id in self.ids or (self.seen_ns is not None and calibration.time_ns < self.seen_ns)


class _Kept(msgspec.Struct):
    """A bias as it is stored: see `Store.save_bias`."""

    x: list[float]
    P: list[list[float]]
    time: float
    temperature_c: float
    powered: float
    lag_k: float
    doubted: bool
    calibration: str
    asked: tuple[str, str] | None
    reached: tuple[int, int] | None
    bridge: str
    #: the whole session, of an estimator that was stopped in order; empty where the bias is all there is
    session: bytes = b""

    def state(self) -> BiasState:
        x, P = np.array(self.x), np.array(self.P)
        return BiasState(x, P, self.time, self.temperature_c, self.powered, lag_k=self.lag_k)


class Store:
    """One open store. `add_…`, `save_…`, `repeat` and `thin` are for the thread that writes, all else for any."""

    def __init__(self, path: Path | str | Database, *, patient: bool = False) -> None:
        self.database = path if isinstance(path, Database) else Database(path, patient=patient)

    @classmethod
    def reading(cls, path: Path | str) -> Self:
        """A store to be read only, in use by an estimator or not."""
        return cls(Database.reading(path))

    @property
    def path(self) -> str:
        """The file."""
        return self.database.path

    def close(self) -> None:
        """Close; what was written is on disk already."""
        self.database.close()

    # ---- what is kept -----------------------------------------------------------------------------------------------

    def add_calibration(self, c: Calibration) -> None:
        """Append an accepted calibration; the same again changes nothing."""
        if c.verdict is not Verdict.ACCEPTED:
            raise ValueError(f"a calibration with verdict {c.verdict.name} is not stored")
        row: Row = {"id": c.id, "device": c.device, "boot": keys.boot_id(c.boot), "time_ns": c.time_ns}
        row |= {
            "method": c.method,
            "verdict": c.verdict.name,
            "reason": _written(c.reason),
            "who": c.who,
            "version": _version(),
        }
        row |= restore_key(c) | {"payload": codec.encode_calibration(c)}
        self.database.insert("calibrations", row, "ON CONFLICT (id) DO NOTHING")

    def add_boot(self, info: DeviceInfo, time_ns: int) -> None:
        """Note a boot; the same boot again changes nothing but what was not known of its device."""
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
        """Keep the latest bias of a boot for a restart; with history also as a point of the device's record.

        doubted, asked: see Remembered; calibration: the one in use then; reached: see Learnt, of one that is not being turned;
        bridge: the one the device is heard from; session: see DeviceSession.state.
        """
        # A restored tracker begins anew with all but the filter's own states.
        x, P = state.x[:OWN].tolist(), state.P[:OWN, :OWN].tolist()
        at = float(state.time), float(state.temperature_c), float(state.powered)
        kept = _Kept(x, P, *at, float(state.lag_k), doubted, calibration, asked, reached, bridge, session)
        with self.database.transaction():
            self._save_state(device, boot, time_ns, msgspec.msgpack.encode(kept))
            if history:
                row: Row = {"device": device, "boot": keys.boot_id(boot), "time_ns": time_ns}
                for axis, name in enumerate("xyz"):
                    row |= {name: float(state.bias[axis]), f"{name}_std": float(state.std[axis])}
                celsius = float(state.temperature_c)  # SQLite makes NULL of NaN
                self.database.insert("bias_history", row | {"temperature_c": celsius})

    def save_epoch(self, epoch: int) -> None:
        """Keep the highest epoch that is known."""
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
        """Append what was asked of the estimator, or what it refused, and what came of it."""
        row: Row = {"time_ns": time_ns, "device": device, "verb": verb, "request_id": request_id, "who": who}
        self.database.insert("audit", row | {"reason": reason, "accepted": int(accepted), "message": _written(message)})

    def repeat(self, device: str, boot: int, time_ns: int, made: Iterable[str] = ()) -> None:
        """Another power-up came under a boot number: the calibrations and the bias kept so far are not of this one.

        made: ids of calibrations of the one before that are still to be kept.
        """
        name = keys.boot_id(boot)
        message = _written((Code.BOOT_NUMBER_REPEATED(),))
        with self.database.transaction():
            self.database.execute(
                "INSERT INTO audit (time_ns, device, verb, request_id, who, accepted, message, reason) SELECT ?, ?, ?, ?, ?, ?,"
                " ?, trim(? || ' ' || ifnull(group_concat(id, ' '), '')) FROM calibrations WHERE device = ? AND boot = ?",
                (
                    time_ns,
                    device,
                    REPEATED,
                    _repeated(device, boot),
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

    def thin(self, device: str, now_ns: int) -> None:
        """Forget what need not be kept any more of a device's past: see retention."""
        with self.database.transaction():
            for statement in THIN:
                self.database.execute(statement, {"device": device, "now_ns": now_ns})

    # ---- what is known ----------------------------------------------------------------------------------------------

    def devices(self) -> list[str]:
        """Every device of which something is kept."""
        tables = ("boots", "calibrations", "bias", "audit")
        found = self.database.select(" UNION ".join(f"SELECT device FROM {table}" for table in tables))  # noqa: S608 - our own words
        return sorted(row["device"] for row in found)

    def calibrated_devices(self) -> set[str]:
        """Every device that has a calibration here."""
        return {row["device"] for row in self.database.select("SELECT DISTINCT device FROM calibrations")}

    def boots(self, device: str, most: int) -> list[int]:
        """Its latest boots, in the order in which they were heard."""
        rows = self.database.rows("boots", "device = ?", (device,), _LATEST_FIRST, most)
        return [int(row["boot"], 16) for row in reversed(rows)]

    def answer(self, device: str, verb: str, request_id: str) -> tuple[bool, Sentences] | None:
        """Whether a command that came before was accepted, and what it was answered."""
        values = device, request_id, verb
        for row in self.database.rows("audit", "device = ? AND request_id = ? AND verb = ?", values, limit=1):
            return bool(row["accepted"]), read_sentences(row["message"])
        return None

    def recall(self, device: str, boot: int, now_ns: int) -> PriorKnowledge | None:
        """The calibration of this very boot, if it has one, with the bias since, and its age at now_ns."""
        calibration = self.calibrated(device, boot)
        for row in self.database.rows("bias", "device = ? AND boot = ?", (device, keys.boot_id(boot))):
            if (kept := _kept(row)) is not None:
                age_s = (now_ns - row["time_ns"]) / 1e9
                found = PriorKnowledge(calibration, kept.state(), age_s, kept.doubted, kept.asked)
                if calibration is not None and kept.calibration != calibration.id:
                    return found.under(calibration)
                return found
        return None if calibration is None else PriorKnowledge(calibration, None)

    def session(self, device: str, boot: int) -> tuple[bytes, str]:
        """The whole session of this very boot, as an estimator stopped in order left it, and the bridge it was heard from."""
        for row in self.database.rows("bias", "device = ? AND boot = ?", (device, keys.boot_id(boot))):
            if (kept := _kept(row)) is not None:
                return kept.session, kept.bridge
        return b"", ""

    def calibrated(self, device: str, boot: int) -> Calibration | None:
        """The calibration of this very boot."""
        made = self.of_boot(device, boot)
        return made[-1] if made else None

    def of_boot(self, device: str, boot: int) -> list[Calibration]:
        """All calibrations of this very boot, in the order in which they were kept."""
        before = self.made_before(device, boot)
        rows = self.database.rows("calibrations", "device = ? AND boot = ?", (device, keys.boot_id(boot)))
        return _calibrations(row for row in rows if row["id"] not in before.ids)

    def made_before(self, device: str, boot: int) -> Before:
        """Of calibrations under this boot number those of an earlier power-up."""
        values = device, _repeated(device, boot), REPEATED
        repeats = self.database.rows("audit", "device = ? AND request_id = ? AND verb = ?", values)
        ids = frozenset(made for row in repeats for made in row["reason"].split())
        return Before(ids, max((row["time_ns"] for row in repeats), default=None))

    def reached(self, since_ns: int) -> dict[str, tuple[int, int, int, str]]:
        """By device boot, sequence number and host time of the last sample that its latest bias knows of, if kept since then.

        And the bridge that it came from, empty where that is not known. Without devices of which a calibration was under way:
        what bridges still keep may hold its turns.
        """
        found: dict[str, tuple[int, int, int, str]] = {}
        for row in self.database.rows("bias", "time_ns >= ?", (since_ns,), "time_ns"):
            found.pop(row["device"], None)
            kept = _kept(row)
            if kept is not None and kept.reached is not None and kept.asked is None:
                found[row["device"]] = int(row["boot"], 16), *kept.reached, kept.bridge
        return found

    def epoch(self) -> int:
        """The highest epoch that was known; 0 where none was."""
        return max((int(row["epoch"]) for row in self.database.rows("epochs")), default=0)

    def prior(self, info: DeviceInfo) -> Calibration | None:
        """The last calibration of an earlier boot under the same restore key: device, model, firmware, range, and mostly rate."""
        this = keys.boot_id(info.boot)
        return self._latest(info.device, lambda row: row["boot"] != this and not differing(row, info))

    def earlier(self, info: DeviceInfo) -> list[Calibration]:
        """The last calibration of each of its latest earlier boots under the same restore key, oldest first."""
        this, found = keys.boot_id(info.boot), dict[str, Row]()
        for row in self.database.rows("calibrations", "device = ?", (info.device,), _LATEST_FIRST, _FEW):
            if row["boot"] not in {this, *found} and not differing(row, info):
                found[row["boot"]] = row
        return _calibrations(reversed(found.values()))

    def latest(self, device: str) -> Calibration | None:
        """The last calibration of a device, whatever it was then."""
        return self._latest(device, lambda _: True)

    def points(self, info: DeviceInfo) -> list[Points]:
        """The bias history of the latest earlier boots under the same restore key, where the temperature is known."""
        this = keys.boot_id(info.boot)
        rows = self.database.rows("boots", "device = ?", (info.device,), _LATEST_FIRST)
        boots = [row for row in rows if row["boot"] != this and not differing(row, info)][:BOOTS]
        return [found for boot in boots if (found := self._points(boot)) is not None]

    def _points(self, boot: Row) -> Points | None:
        where = "device = ? AND boot = ? AND time_ns >= ? AND temperature_c IS NOT NULL"
        values = boot["device"], boot["boot"], boot["time_ns"]
        rows = self.database.rows("bias_history", where, values, "time_ns", POINTS)
        names = ("time_ns", "x", "y", "z", "x_std", "y_std", "z_std", "temperature_c")
        table = np.array([[row[name] for name in names] for row in rows], float)
        return Points(1e-9 * table[:, 0], table[:, 1:4], table[:, 4:7], table[:, 7]) if len(table) else None

    def calibrations(self, device: str) -> list[Calibration]:
        """All calibrations of a device, oldest first."""
        return _calibrations(self.database.rows("calibrations", "device = ?", (device,), "time_ns, number"))

    def _latest(self, device: str, wanted: Callable[[Row], bool]) -> Calibration | None:
        for few in (_FEW, -1):
            rows = self.database.rows("calibrations", "device = ?", (device,), _LATEST_FIRST, few)
            if found := _calibrations(row for row in rows if wanted(row)):
                return found[0]
        return None


def _calibrations(rows: Iterable[Row]) -> list[Calibration]:
    found = []
    for row in rows:
        try:
            place = keys.build("store", "calibration", device=row["device"])
            found.append(codec.decode_calibration(place, row["payload"]))
        except Refusal as refusal:  # of a truerate that took what this one does not
            log.error("calibration %s of %s is not used: %s", row["id"], row["device"], refusal)
    return found


def _written(sentences: Sentences) -> str:
    """Sentences as a text column holds them: JSON."""
    return msgspec.json.encode(sentences).decode()


def read_sentences(text: str) -> Sentences:
    """The sentences of a text column."""
    return msgspec.json.decode(text, type=Sentences)


def _kept(row: dict[str, Any]) -> _Kept | None:
    """What a row of `bias` holds; None where another power-up came under its boot number."""
    return msgspec.msgpack.decode(row["state"], type=_Kept) if row["state"] else None


def _repeated(device: str, boot: int) -> str:
    """The request id under which the audit has it."""
    return f"{device} {keys.boot_id(boot)}"


@cache
def _version() -> str:
    return version("truerate")

"""What the estimator keeps of a ward: calibrations, boots, the history of biases, and an audit of commands.

Append-only but for the latest bias of each boot, an audit that would grow without end, and boots and the bias history, which are
thinned as they grow old (`retention`). Every row is sealed (estimator/database): what was damaged on disk is refused and
reported, never used.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from bridge.wire import codec, keys
from bridge.wire.messages import BootCause, Calibration, DeviceInfo, Verdict
from bridge.wire.refusal import Refusal
from estimator.database import Change, Database, Row, StoreError, Trim
from estimator.remembered import Remembered
from estimator.restore import differing, restore_key
from estimator.service.retention import ALL_DAYS, DAY_NS, YEAR_NS, old_boots, superfluous
from estimator.track.bias_filter import OWN, BiasState
from estimator.track.learning import Points

__all__ = ["BOOTS", "POINTS", "Store", "StoreError"]

#: what a temperature law is learnt from: so many boots, and so many points, the first, of each
BOOTS, POINTS = 8, 300
#: under this the audit has that a boot number came again
REPEATED = "boot number repeated"
#: of each device the audit keeps about so many lines, those of years; looked after every so many
AUDITED, _LOOKED_AFTER = 10_000, 100
#: which is the latest: what was written last, whatever time it says, by a clock that may have been wrong then
_WRITTEN = "rowid DESC"
#: so many calibrations of a device are looked at whatever they are of; found by an index alone, there may be thousands
_LATEST = "rowid IN (SELECT rowid FROM calibrations WHERE device = ? ORDER BY rowid DESC LIMIT 8)"
#: how many points are thinned at a time
STRETCH = 500
#: of so many devices it is known how their boot was noted last
_BEGUN = 4096
#: rows to look at where one would do: it may be damaged
_SOME = 8
#: under which boots teach the same law
_KEY = ("model", "firmware", "gyro_range")
#: no device's name: of which the highest epoch is kept beside the biases
_WARD = ""
#: things a bias is kept as; after them what else is known of the boot
_STATE = 5


class Before(NamedTuple):
    """Calibrations under a boot number that came again, of the power-ups before; when that was seen, None where it did not."""

    ids: frozenset[str]
    seen_ns: int | None

    def has(self, calibration: Calibration) -> bool:
        """Whether it is one of them, as far as one knows."""
        return calibration.id in self.ids or (self.seen_ns is not None and calibration.time_ns < self.seen_ns)


class Store:
    """One open store; used from one thread. `patient`: where the disk does not let us, it goes on without and tries again."""

    def __init__(self, path: Path | str | Database, *, patient: bool = False) -> None:
        self.database = path if isinstance(path, Database) else Database(path, patient=patient)
        self._audited: Counter[str] = Counter()
        self._begun = dict[str, Row]()  # as the latest boot of a device was noted last

    @classmethod
    def reading(cls, path: Path | str) -> Self:
        """A store as it is, be it in use by an estimator; nothing is written."""
        return cls(Database.reading(path))

    @property
    def path(self) -> str:
        """The file."""
        return self.database.path

    def close(self) -> None:
        """Close; what was written is on disk already."""
        self.database.close()

    # ---- what is kept -----------------------------------------------------------------------------------------------

    def add_calibration(self, calibration: Calibration) -> None:
        """Append a calibration, before anyone is told of it; only an accepted one is a calibration."""
        if calibration.verdict is not Verdict.ACCEPTED:
            raise ValueError(f"a calibration with verdict {calibration.verdict.name} is not stored")
        self.database.write(Change("calibrations", _as_row(calibration)))

    def add_boot(self, info: DeviceInfo, time_ns: int) -> None:
        """Note a boot; the same boot again changes nothing but what was not known of its device."""
        row: Row = {"device": info.device, "boot": keys.boot_id(info.boot), "time_ns": time_ns}
        row |= {"cause": BootCause(info.boot_cause).name, **restore_key(info)}
        kept = None
        known = self._begun.pop(info.device, None)  # which may not be written yet
        if known is None or known["boot"] != row["boot"]:
            rows = self.database.rows("boots", "device = ? AND boot = ?", (row["device"], row["boot"]))
            known = kept = rows[0] if rows else None
        whole = row if known is None else known | {name: known.get(name) or value for name, value in row.items()}
        if whole != kept:
            self.database.write(Change("boots", whole, "REPLACE"))
        self._begun[info.device] = whole
        while len(self._begun) > _BEGUN:
            del self._begun[next(iter(self._begun))]

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
    ) -> None:
        """Keep the latest bias of a boot for a restart; with history also as a point of the device's record.

        doubted, asked: see Remembered; calibration: the one in use then; reached: see Learnt, of one that is not being turned;
        bridge: who it is heard from.
        """
        at = state.time, _or_none(state.temperature_c), _or_none(state.powered)
        # A restored tracker begins anew with all but the filter's own states.
        x, P = state.x[:OWN].tolist(), state.P[:OWN, :OWN].tolist()
        more = {"doubted": doubted, "calibration": calibration, "asked": asked, "reached": reached}
        more |= {"lag_k": state.lag_k, "bridge": bridge}
        text = json.dumps([x, P, *at, more])
        latest: Row = {"device": device, "boot": keys.boot_id(boot), "time_ns": time_ns, "state": text}
        changes = [Change("bias", latest, "REPLACE")]
        if history:
            changes.append(Change("bias_history", _point(device, boot, time_ns, state)))
        self.database.write(*changes)

    def save_epoch(self, epoch: int, time_ns: int) -> None:
        """Keep the highest epoch that is known."""
        text = json.dumps([[], [], 0.0, None, None, {"epoch": epoch}])
        row: Row = {"device": _WARD, "boot": keys.boot_id(0), "time_ns": time_ns, "state": text}
        self.database.write(Change("bias", row, "REPLACE"))

    def add_audit(
        self,
        time_ns: int,
        device: str,
        verb: str,
        request_id: str,
        who: str,
        reason: str,
        message: str,
        *,
        accepted: bool,
    ) -> None:
        """Append what was asked of the estimator, or what it refused, and what came of it."""
        row: Row = {"time_ns": time_ns, "device": device, "verb": verb, "request_id": request_id, "who": who}
        row |= {"reason": reason, "accepted": int(accepted), "message": message}
        trims = [] if self._audited[device] % _LOOKED_AFTER else [Trim("audit", "device", device, AUDITED)]
        self.database.write(Change("audit", row), *trims)
        self._audited[device] += 1

    def repeat(self, device: str, boot: int, time_ns: int, made: Iterable[str] = ()) -> None:
        """Another power-up came under a boot number: what is kept under it is not of this one.

        made: ids of calibrations of the one before that may be kept later.
        """
        name = keys.boot_id(boot)
        kept = self.database.rows("calibrations", "device = ? AND boot = ?", (device, name))
        row: Row = {"time_ns": time_ns, "device": device, "verb": REPEATED, "request_id": _repeated(device, boot)}
        row |= {"who": "estimator", "reason": " ".join(sorted({*made, *(c["id"] for c in kept)})), "accepted": 1}
        row |= {"message": "another power-up under the same boot number: to be calibrated anew"}
        nothing: Row = {"device": device, "boot": name, "time_ns": time_ns, "state": "[]"}
        self.database.write(Change("audit", row), Change("bias", nothing, "REPLACE"))

    def boots(self, device: str, most: int) -> list[int]:
        """Its latest boots, in the order in which they were heard."""
        rows = self.database.rows("boots", "device = ?", (device,), "rowid DESC", most)
        return [int(row["boot"], 16) for row in reversed(rows)]

    def boots_kept(self, device: str) -> list[str]:
        """Every boot of which there is a bias, oldest first."""
        return [row["boot"] for row in self.database.rows("bias", "device = ?", (device,), "time_ns")]

    def thin(self, device: str, boot: str, after_ns: int, now_ns: int) -> int | None:
        """Thin a stretch of a boot's bias history, from after_ns on; where to go on, or None when that was all."""
        old_ns = now_ns - ALL_DAYS * DAY_NS
        where, values = "device = ? AND boot = ? AND time_ns > ? AND time_ns < ?", (device, boot, after_ns, old_ns)
        rows = self.database.rows("bias_history", where, values, "time_ns", STRETCH)
        times = [row["time_ns"] for row in rows]
        spared = self._learnt_from(device, boot, rows) if not after_ns else 0
        gone = [(device, boot, times[i]) for i in superfluous(times, now_ns, spared)]
        if gone and not self._leapt("bias_history", device, now_ns):
            self.database.remove("bias_history", "device = ? AND boot = ? AND time_ns = ?", gone)
        return times[-1] if times else None  # fewer than a stretch may be all of it that is whole

    def thin_boots(self, device: str, now_ns: int) -> int:
        """Forget old boots of a device that began many times, and their biases; how many. Those that were calibrated are kept."""
        boots = self.database.rows("boots", "device = ?", (device,))
        begun = {row["boot"]: row["time_ns"] for row in self.database.rows("bias", "device = ?", (device,))}
        begun |= {row["boot"]: row["time_ns"] for row in boots}
        # A time that lies ahead would be among the latest for ever.
        names = sorted((name for name, time_ns in begun.items() if time_ns <= now_ns), key=begun.__getitem__)
        if names and self._leapt("boots", device, now_ns):
            now_ns = begun[names[0]]
        old = [names[i] for i in old_boots([begun[name] for name in names], now_ns)]
        if not old:
            return 0
        kept = {row["boot"] for row in self.database.rows("calibrations", "device = ?", (device,))}
        taught = Counter[tuple[Any, ...]]()
        for row in reversed(boots):
            key = tuple(row[name] for name in _KEY)
            taught[key] += 1
            if taught[key] <= BOOTS + 1:
                kept.add(row["boot"])
        gone = [(device, name) for name in old if name not in kept][:STRETCH]
        for table in ("bias_history", "bias", "boots") if gone else ():
            self.database.remove(table, "device = ? AND boot = ?", gone)
        return len(gone)

    def _leapt(self, table: str, device: str, now_ns: int) -> bool:
        """Whether nothing was kept in the year before yesterday: the clock may be wrong, and nothing as old as it says."""
        values = device, now_ns - YEAR_NS, now_ns - DAY_NS
        return not self.database.rows(table, "device = ? AND time_ns > ? AND time_ns < ?", values, limit=_SOME)

    def _learnt_from(self, device: str, boot: str, rows: list[Row]) -> int:
        """How many points of a boot, from its first on, `points` may ask for."""
        boots = self.database.rows("boots", "device = ?", (device,), _WRITTEN)
        key = next(([row[name] for name in _KEY] for row in boots if row["boot"] == boot), None)
        # One more: the present boot is not learnt from yet.
        if boot not in [row["boot"] for row in boots if [row[name] for name in _KEY] == key][: BOOTS + 1]:
            return 0
        known = [i for i, row in enumerate(rows) if row["temperature_c"] is not None][:POINTS]
        return known[-1] + 1 if known else 0

    # ---- what is known ----------------------------------------------------------------------------------------------

    def answer(self, device: str, verb: str, request_id: str) -> tuple[bool, str] | None:
        """Whether a command that came before was accepted, and the words it was answered with."""
        for row in self.database.rows("audit", "request_id = ?", (request_id,)):
            if (row["device"], row["verb"]) == (device, verb):
                return bool(row["accepted"]), row["message"]
        return None

    def recall(self, device: str, boot: int, now_ns: int) -> Remembered | None:
        """The calibration of this very boot, if it has one, with the bias since, and its age at now_ns."""
        name, calibration = keys.boot_id(boot), self.calibrated(device, boot)
        for row in self.database.rows("bias", "device = ? AND boot = ?", (device, name)):
            kept = json.loads(row["state"])
            if (bias := _state(kept)) is not None:
                more = _more(kept)
                asked = tuple(more["asked"]) if more.get("asked") else None
                age_s, doubted = (now_ns - row["time_ns"]) / 1e9, more.get("doubted", False)
                found = Remembered(calibration, bias, age_s, doubted, asked)
                if calibration is not None and more.get("calibration", calibration.id) != calibration.id:
                    return found.under(calibration)
                return found
        return None if calibration is None else Remembered(calibration, None)

    def calibrated(self, device: str, boot: int) -> Calibration | None:
        """The calibration of this very boot."""
        name, before = keys.boot_id(boot), self.made_before(device, boot)
        return self._latest(device, lambda row: row["boot"] == name and row["id"] not in before.ids, "boot = ?", name)

    def made_before(self, device: str, boot: int) -> "Before":
        """Of calibrations under this boot number those of another power-up."""
        rows = self.database.rows("audit", "request_id = ?", (_repeated(device, boot),))
        repeats = [row for row in rows if row["verb"] == REPEATED]
        ids = frozenset(made for row in repeats for made in row["reason"].split())
        return Before(ids, max((row["time_ns"] for row in repeats), default=None))

    def of_boot(self, device: str, boot: int) -> list[Calibration]:
        """The latest calibrations of this very boot, in the order in which they were kept."""
        name, before = keys.boot_id(boot), self.made_before(device, boot)
        rows = self.database.rows("calibrations", _LATEST, (device,))
        made = (self._calibration(row) for row in rows if row["boot"] == name and row["id"] not in before.ids)
        return [one for one in made if one is not None]

    def reached(self, since_ns: int) -> dict[str, tuple[int, int, int, str]]:
        """By device boot, sequence number and host time of the last sample that its latest bias knows of, if kept since then.

        And the bridge that it came from, empty where that is not known.

        Without those of which a calibration was under way: what bridges still keep may hold its turns.
        """
        found: dict[str, tuple[int, int, int, str]] = {}
        for row in self.database.rows("bias", "time_ns >= ?", (since_ns,), "time_ns"):
            kept = json.loads(row["state"])
            more = _more(kept)
            found.pop(row["device"], None)
            if more.get("reached") and not more.get("asked"):
                found[row["device"]] = int(row["boot"], 16), *more["reached"], more.get("bridge", "")
        return found

    def epoch(self) -> int:
        """The highest epoch that was known; 0 where none was."""
        rows = self.database.rows("bias", "device = ?", (_WARD,))
        return max((int(_more(json.loads(row["state"])).get("epoch", 0)) for row in rows), default=0)

    def prior(self, info: DeviceInfo) -> Calibration | None:
        """The last calibration of an earlier boot under the same restore key: device, model, firmware, range, and mostly rate."""
        this = keys.boot_id(info.boot)
        return self._latest(info.device, lambda row: row["boot"] != this and not differing(row, info))

    def earlier(self, info: DeviceInfo) -> list[Calibration]:
        """The last calibration of each of its latest earlier boots under the same restore key, oldest first."""
        this, found = keys.boot_id(info.boot), dict[str, Calibration]()
        for row in self.database.rows("calibrations", _LATEST, (info.device,), _WRITTEN):
            if row["boot"] in {this, *found} or differing(row, info):
                continue
            if (made := self._calibration(row)) is not None:
                found[row["boot"]] = made
        return list(found.values())[::-1]

    def latest(self, device: str) -> Calibration | None:
        """The last calibration of a device, whatever it was then."""
        return self._latest(device, lambda _: True)

    def points(self, info: DeviceInfo) -> list[Points]:
        """The bias history of the latest earlier boots under the same restore key, where the temperature is known."""
        this = keys.boot_id(info.boot)
        rows = self.database.rows("boots", "device = ?", (info.device,), _WRITTEN)
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
        """All whole calibrations of a device, oldest first."""
        rows = self.database.rows("calibrations", "device = ?", (device,), "time_ns, rowid")
        return [found for row in rows if (found := self._calibration(row)) is not None]

    def _latest(
        self, device: str, wanted: Callable[[Row], bool], where: str = "1", *values: object
    ) -> Calibration | None:
        # What it is looked up by is tried here, behind the seals: SQLite would pass over a damaged column in silence. It is
        # asked only for those of long ago, to look through which takes as long as hundreds of samples.
        for some, given in ((_LATEST, ()), (f"device = ? AND {where}", values)):
            for row in self.database.rows("calibrations", some, (device, *given), _WRITTEN):
                if wanted(row) and (found := self._calibration(row)) is not None:
                    return found
        return None

    def _calibration(self, row: Row) -> Calibration | None:
        place = keys.build("store", "calibration", device=row["device"])
        try:
            found = codec.decode_calibration(place, row["payload"])
        except Refusal as refusal:
            self.database.refuse("calibrations", f"{row['id']}: {refusal}")
            return None
        if not _has(row, {"boot": keys.boot_id(found.boot), "time_ns": found.time_ns} | restore_key(found)):
            self.database.refuse("calibrations", f"{row['id']}: its columns are not those of its content")
            return None
        return found


def _repeated(device: str, boot: int) -> str:
    """What the audit has of it is found by."""
    return f"{device} {keys.boot_id(boot)}"


def _point(device: str, boot: int, time_ns: int, state: BiasState) -> Row:
    row: Row = {"device": device, "boot": keys.boot_id(boot), "time_ns": time_ns}
    for axis, name in enumerate("xyz"):
        row |= {name: float(state.bias[axis]), f"{name}_std": float(state.std[axis])}
    return row | {"temperature_c": _or_none(state.temperature_c)}


def _has(row: Row, part: Row) -> bool:
    return all(row[name] == value for name, value in part.items())


def _as_row(c: Calibration) -> Row:
    row: Row = {"id": c.id, "device": c.device, "boot": keys.boot_id(c.boot), "time_ns": c.time_ns, "method": c.method}
    row |= {"verdict": c.verdict.name, "reason": c.reason, "who": c.who, "version": _version()}
    return row | restore_key(c) | {"payload": codec.encode_calibration(c)}


@cache
def _version() -> str:
    return version("truerate")


def _state(kept: list[Any]) -> BiasState | None:
    if len(kept) < _STATE or len(kept[0]) < OWN:  # of an earlier truerate: the calibration's own bias is used
        return None
    x, P, time, temperature, powered = kept[:_STATE]
    celsius, since = np.nan if temperature is None else temperature, -np.inf if powered is None else powered
    return BiasState(np.array(x), np.array(P), time, celsius, since, lag_k=_more(kept).get("lag_k", 0.0))


def _more(kept: list[Any]) -> dict[str, Any]:
    """What else is known of the boot; of an earlier truerate nothing."""
    return kept[_STATE] if len(kept) > _STATE else {}


def _or_none(value: float) -> float | None:
    return value if np.isfinite(value) else None

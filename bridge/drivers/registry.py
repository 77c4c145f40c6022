"""Registry of drivers by name: built-in drivers, and those of other packages (entry points `truerate.drivers`)."""

import functools
import logging
from collections.abc import Iterator, Mapping
from importlib import import_module

from bridge.drivers.driver import DriverKind

GROUP = "truerate.drivers"
#: built-in drivers, each in the module of the same name, imported on first use
OURS = (
    "native",
    "ximu3",
    "witmotion",
    "mtdata2",
    "text_profile",
    "mavlink",
    "movella_dot",
    "shimmer3",
    "lsl",
    "replayed",
    "simulated",
)

_log = logging.getLogger(__name__)


class _Kinds(Mapping[str, DriverKind]):
    def __getitem__(self, name: str) -> DriverKind:
        return _ours(name) if name in OURS else foreign()[name]

    def __iter__(self) -> Iterator[str]:
        yield from OURS
        yield from foreign()

    def __len__(self) -> int:
        return len(OURS) + len(foreign())


_KINDS = _Kinds()


def kinds() -> Mapping[str, DriverKind]:
    """Return all drivers by name, built-in drivers first. A built-in driver is imported at its first use."""
    return _KINDS


def _ours(name: str) -> DriverKind:
    kind: DriverKind = import_module(f"bridge.drivers.{name}").KIND
    return kind


@functools.cache
def foreign() -> dict[str, DriverKind]:
    """Return the drivers that other packages register, by name.

    A driver is left out, with a warning in the log, if it cannot be loaded or its name is already taken.
    """
    from importlib.metadata import entry_points  # noqa: PLC0415 - slow, and not needed for built-in drivers

    found: dict[str, DriverKind] = {}
    for entry in entry_points(group=GROUP):
        try:
            kind = entry.load()
        except Exception as error:  # noqa: BLE001 - a faulty foreign driver must not stop the others
            _log.warning("driver %s (%s) cannot be loaded: %s; reinstall its package", entry.name, entry.value, error)
            continue
        if not isinstance(kind, DriverKind) or kind.name in (*OURS, *found):
            _log.warning(
                "driver %s (%s) is ignored: it is not a DriverKind, or its name is taken", entry.name, entry.value
            )
            continue
        found[kind.name] = kind
    return found

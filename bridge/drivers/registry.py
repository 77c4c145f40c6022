"""The drivers by name: ours, and those that installed packages offer as entry points of the group `truerate.drivers`."""

import functools
import logging
from importlib.metadata import entry_points

from bridge.drivers import mavlink, mtdata2, native, replayed, simulated, text_profile, witmotion, ximu3
from bridge.drivers.driver import DriverKind

GROUP = "truerate.drivers"
OURS = (
    native.KIND,
    ximu3.KIND,
    witmotion.KIND,
    mtdata2.KIND,
    text_profile.KIND,
    mavlink.KIND,
    replayed.KIND,
    simulated.KIND,
)

_log = logging.getLogger(__name__)


@functools.cache
def kinds() -> dict[str, DriverKind]:
    """Every driver by name. A foreign one that cannot be loaded, or takes a name of ours, is left out with a warning."""
    found = {kind.name: kind for kind in OURS}
    for entry in entry_points(group=GROUP):
        try:
            kind = entry.load()
        except Exception as error:  # noqa: BLE001 - code of others must not stop ours
            _log.warning("driver %s (%s) cannot be loaded: %s", entry.name, entry.value, error)
            continue
        if not isinstance(kind, DriverKind) or kind.name in found:
            _log.warning("driver %s (%s) is left out: not a DriverKind of a free name", entry.name, entry.value)
            continue
        found[kind.name] = kind
    return found

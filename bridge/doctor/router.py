"""Whether a ward's router can be reached."""

from collections.abc import Callable, Sequence

from bridge.bus.contract import Bus, BusError
from bridge.bus.zenoh_bus import ZenohBus
from bridge.doctor.finding import Finding, ok, trouble


def router(endpoints: Sequence[str], open_bus: Callable[[Sequence[str]], Bus] = ZenohBus) -> list[Finding]:
    """Joins and leaves again."""
    where = ", ".join(endpoints)
    try:
        open_bus(endpoints).close()
    except BusError as error:
        return [
            trouble(
                "router",
                str(error),
                "start it: `truerate router` on its machine, or zenohd; or set `connect` in [bus] to where it is",
            )
        ]
    return [ok("router", f"reached at {where}")]

"""Why nothing is understood of a device that is open: what its bytes look like, in words, with what to do."""

from collections.abc import Sequence

from bridge.drivers import registry
from bridge.drivers.driver import Driver
from bridge.drivers.stream import StreamDriver
from bridge.scan.guess import candidates, guesses
from bridge.transport.transport import Chunk


def why(driver: Driver, name: str) -> str:
    """In words that stay the same while nothing changes. name: of the driver, as the configuration calls it."""
    if not isinstance(driver, StreamDriver):
        return f"{driver.place}: open, but nothing that is understood comes"
    chunks = driver.unread()
    if not chunks:
        return f"{driver.place}: open, but nothing comes; is it on, and sending?"
    return f"{driver.place}: bytes come, but not {name}'s; {_advice(chunks, driver.place, name)}"


def _advice(chunks: Sequence[Chunk], place: str, name: str) -> str:
    others = [candidate for candidate in candidates(registry.kinds().values()) if candidate.kind.name != name]
    best = next(iter(guesses(others, chunks)), None)
    if best is not None and best.understood:
        keys = {"driver": best.candidate.kind.name, **best.candidate.table}
        return f"they look like {', '.join(f'{key} = {value!r}' for key, value in keys.items())}: put that into the ward's file"
    speed = "another speed, or another protocol" if "://" not in place else "another protocol"
    return f"{speed}? Stop the bridge, and `truerate bridge scan --port {place}` finds out"

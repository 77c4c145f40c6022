"""Why an open device gives no samples: no bytes, or bytes of another protocol; in words, with what to do."""

from collections.abc import Sequence

from bridge.drivers import registry
from bridge.drivers.driver import Driver
from bridge.drivers.stream import StreamDriver
from bridge.scan.guess import candidates, guesses
from bridge.transport.transport import Chunk
from bridge.wording import count


def why(driver: Driver, name: str) -> str:
    """One sentence, the same while nothing changes. name: the driver's, as in the ward's file."""
    if not isinstance(driver, StreamDriver):
        return f"{driver.place}: open, but nothing that is understood comes"
    chunks = driver.unread()
    if not chunks:
        return f"{driver.place}: open, but nothing comes; is it on, and sending?"
    return f"{driver.place}: bytes come, but not {name}'s; {_advice(chunks, driver.place, name)}"


def ended(driver: Driver, name: str) -> str:
    """Why a capture that has ended gave no sample; empty if it gave some."""
    if not isinstance(driver, StreamDriver) or driver.samples_in:
        return ""
    if not driver.bytes_in:
        return f"{driver.place}: it is over, and there was nothing in it: 0 bytes"
    came = f"{count(driver.bytes_in, 'byte')} came, and no sample of {name}'s is in them"
    return f"{driver.place}: it is over: {came}; {_advice(driver.unread(), driver.place, name)}"


def _advice(chunks: Sequence[Chunk], place: str, name: str) -> str:
    others = [candidate for candidate in candidates(registry.kinds().values()) if candidate.kind.name != name]
    best = next(iter(guesses(others, chunks)), None)
    if best is not None and best.understood:
        keys = {"driver": best.candidate.kind.name, **best.candidate.table}
        return f"they look like {', '.join(f'{key} = {value!r}' for key, value in keys.items())}: put that into the ward's file"
    speed = "another speed, or another protocol" if "://" not in place else "another protocol"
    first = "" if place.startswith("file://") else "Stop the bridge, and "
    return f"{speed}? {first}`truerate bridge scan --port {place}` finds out"

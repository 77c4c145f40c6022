"""Explains why an open device gives no samples (no bytes, or bytes of another protocol), with advice."""

from collections.abc import Sequence

from bridge.diagnose.protocol_guess import candidates, guesses
from bridge.drivers import registry
from bridge.drivers.byte_stream import StreamDriver
from bridge.drivers.driver import Driver
from bridge.reasons.codes import Code, Sentence, Sentences
from bridge.transport.transport import Chunk


def no_data_reason(driver: Driver, name: str) -> Sentences:
    """Explain why an open device sends no samples (no bytes, or bytes of another protocol), with advice, as sentences.

    Repeated calls give equal sentences while nothing changes. name: the driver's name in the configuration.
    """
    if not isinstance(driver, StreamDriver):
        return (Code.NOTHING_UNDERSTOOD(place=driver.place),)
    chunks = driver.unread()
    if not chunks:
        return (Code.NOTHING_COMES(place=driver.place),)
    return Code.BYTES_OF_ANOTHER(place=driver.place, driver=name), _advice(chunks, driver.place, name)


def ended(driver: Driver, name: str) -> Sentences:
    """Explain why a capture ended without a sample, with advice, as sentences; () if the capture had samples.

    name: the driver's name in the configuration.
    """
    if not isinstance(driver, StreamDriver) or driver.samples_in:
        return ()
    if not driver.bytes_in:
        return (Code.CAPTURE_EMPTY(place=driver.place),)
    over = Code.CAPTURE_WITHOUT_SAMPLES(place=driver.place, bytes=driver.bytes_in, driver=name)
    return over, _advice(driver.unread(), driver.place, name)


def _advice(chunks: Sequence[Chunk], place: str, name: str) -> Sentence:
    others = [candidate for candidate in candidates(registry.kinds().values()) if candidate.kind.name != name]
    best = next(iter(guesses(others, chunks)), None)
    if best is not None and best.understood:
        keys = {"driver": best.candidate.kind.name, **best.candidate.table}
        return Code.LOOKS_LIKE(settings=", ".join(f"{key} = {value!r}" for key, value in keys.items()))
    return Code.TRY_SCAN(place=place)

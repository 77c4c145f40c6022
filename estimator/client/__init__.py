"""The Python way to subscribe: corrected rates, revisions, status and calibrations of a ward, and commands to its estimator.

from estimator.client import Client

    with Client(ward="demo") as ward:
        for batch in ward.corrected():  # or `async for`
            print(batch.device, batch.quality.name, batch.rate[-1], "std", batch.rate_std[-1])
"""

from bridge.bus.contract import BusError
from estimator.client.client import Client
from estimator.client.reorder_buffer import Miss
from estimator.client.revision import covers, revised
from estimator.client.stream import Corrected, Stream

__all__ = ["BusError", "Client", "Corrected", "Miss", "Stream", "covers", "revised"]

"""Python client of a ward: subscribe to corrected rates, revisions, status and calibrations; command the estimator.

Entry point: `Client`.
"""

from bridge.bus.contract import BusError
from estimator.client.client import Client
from estimator.client.reorder_buffer import Miss
from estimator.client.revision import covers, revised
from estimator.client.stream import Corrected, Stream

__all__ = ["BusError", "Client", "Corrected", "Miss", "Stream", "covers", "revised"]

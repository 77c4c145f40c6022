"""FOR THE INTEGRATOR: goes when `Bus.subscribe` takes several patterns; then client.py calls that itself."""

from collections.abc import Sequence

from bridge.bus.contract import Bus, Subscription
from bridge.bus.together import Together


def subscribe(bus: Bus, patterns: Sequence[str], *, history: bool, capacity: int) -> Subscription:
    """One subscription to all that matches one of some patterns: `bus.subscribe(patterns, …)`."""
    parts = [bus.subscribe(pattern, history=history, capacity=capacity) for pattern in patterns]
    return Together(parts, capacity) if len(parts) > 1 else parts[0]

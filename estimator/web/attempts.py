"""How often somebody may try a password. Pure: time is an argument."""

from collections import OrderedDict

#: wrong passwords that are forgiven at once, and how long each takes to be forgotten
FREE, FORGET_S = 5, 30.0
#: addresses that are remembered
ADDRESSES = 4096


class Attempts:
    """Wrong passwords by address."""

    def __init__(self) -> None:
        self._until: OrderedDict[str, float] = OrderedDict()

    def wait_s(self, address: str, now: float) -> float:
        """Seconds until another try is taken from an address; 0 when now."""
        owed_s = self._until.get(address, now) - now
        return max(0.0, owed_s - (FREE - 1) * FORGET_S)

    def failed(self, address: str, now: float) -> None:
        """A wrong password came."""
        self._until[address] = max(self._until.pop(address, now), now) + FORGET_S
        while len(self._until) > ADDRESSES:
            self._until.popitem(last=False)

    def succeeded(self, address: str) -> None:
        """The right one came."""
        self._until.pop(address, None)

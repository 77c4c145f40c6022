"""How often somebody may try a password. Pure: time is an argument."""

from collections import OrderedDict

#: wrong passwords of a name, and of all names, that are forgiven at once from an address
FREE, FREE_OF_ALL = 5, 25
#: how long each takes to be forgotten
FORGET_S = 30.0
#: addresses, and names tried from them, that are remembered
REMEMBERED = 4096


class Attempts:
    """Wrong passwords by address and name. A right one clears its name's count there, and nobody else's."""

    def __init__(self) -> None:
        self._until: OrderedDict[tuple[str, str], float] = OrderedDict()

    def wait_s(self, address: str, name: str, now: float) -> float:
        """Seconds until another try for a name is taken from an address; 0 when now."""
        of_all, of_name = (self._until.get(key, now) - now for key in _keys(address, name))
        return max(0.0, of_name - (FREE - 1) * FORGET_S, of_all - (FREE_OF_ALL - 1) * FORGET_S)

    def failed(self, address: str, name: str, now: float) -> None:
        """A wrong password came."""
        for key in _keys(address, name):
            self._until[key] = max(self._until.pop(key, now), now) + FORGET_S
        while len(self._until) > REMEMBERED:
            self._until.popitem(last=False)

    def succeeded(self, address: str, name: str) -> None:
        """The right one came."""
        self._until.pop((address, name), None)


def _keys(address: str, name: str) -> tuple[tuple[str, str], tuple[str, str]]:
    """Of all names, and of this one: nobody is called nothing."""
    return (address, ""), (address, name)

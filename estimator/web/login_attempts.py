"""How often somebody may try a password. Pure: time is an argument."""

from collections import OrderedDict

#: each wrong password is forgotten after so long
FORGET_S = 30.0
#: wrong passwords that are taken at once: for a name from one address, from that address for all names (behind it may be a
#: whole ward), and for a name from everywhere, which no single address uses up: nobody locks others out alone
FREE, ADDRESS_FREE, NAME_FREE = 5, 20, 50
#: who had the right one from an address is not kept out there by what strangers try of that name elsewhere
#: of each, so many are remembered
REMEMBERED = 4096


class Attempts:
    """Wrong passwords by address and by name.

    A right one clears its name there and nothing else: who has a password of their own cannot guess others for ever.
    """

    def __init__(self) -> None:
        self._both, self._addresses, self._names = _Owed(FREE), _Owed(ADDRESS_FREE), _Owed(NAME_FREE)
        self._right = OrderedDict[tuple[str, str], None]()

    def wait_s(self, address: str, name: str, now: float) -> float:
        """Seconds until another try is taken; 0 when now."""
        here = max(self._both.wait_s((address, name), now), self._addresses.wait_s((address,), now))
        return here if (address, name) in self._right else max(here, self._names.wait_s((name,), now))

    def failed(self, address: str, name: str, now: float) -> None:
        """A wrong password came."""
        self._both.add((address, name), now)
        self._addresses.add((address,), now)
        self._names.add((name,), now)

    def succeeded(self, address: str, name: str) -> None:
        """The right one came."""
        self._both.clear((address, name))
        self._right[address, name] = None
        self._right.move_to_end((address, name))
        while len(self._right) > REMEMBERED:
            self._right.popitem(last=False)


class _Owed:
    """Time owed by each: every wrong password adds to it, and it passes by itself."""

    def __init__(self, free: int) -> None:
        self._free_s = (free - 1) * FORGET_S
        self._until: OrderedDict[tuple[str, ...], float] = OrderedDict()

    def wait_s(self, who: tuple[str, ...], now: float) -> float:
        return max(0.0, self._until.get(who, now) - now - self._free_s)

    def add(self, who: tuple[str, ...], now: float) -> None:
        self._until[who] = max(self._until.pop(who, now), now) + FORGET_S
        while len(self._until) > REMEMBERED:
            self._until.popitem(last=False)

    def clear(self, who: tuple[str, ...]) -> None:
        self._until.pop(who, None)

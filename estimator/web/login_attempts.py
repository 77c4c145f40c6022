"""Rate limit for wrong passwords, by client address and by person. Pure: time is an argument."""

from collections import OrderedDict

#: each wrong password is forgotten after this long, s
FORGET_S = 30.0
#: wrong passwords accepted at once: for a name from one address; from one address (perhaps a whole ward's) for all
#: names; for a name from everywhere. A single address cannot use up the last, so nobody locks others out alone
FREE, ADDRESS_FREE, NAME_FREE = 5, 20, 50
#: most entries remembered of each kind. An address that once gave the right password is not locked out by attempts
#: on that name elsewhere
REMEMBERED = 4096


class Attempts:
    """Counter of wrong passwords: by client address, by person's name, and by both together.

    Each count falls by one every FORGET_S seconds. A right password clears only the count of its own name at its own
    address. So a person with a password cannot guess other people's passwords without limit.
    """

    def __init__(self) -> None:
        self._both, self._addresses, self._names = _Owed(FREE), _Owed(ADDRESS_FREE), _Owed(NAME_FREE)
        self._right = OrderedDict[tuple[str, str], None]()

    def wait_s(self, address: str, name: str, now: float) -> float:
        """Return the seconds until another attempt is accepted; 0 if it is accepted now. now: monotonic time, s."""
        here = max(self._both.wait_s((address, name), now), self._addresses.wait_s((address,), now))
        return here if (address, name) in self._right else max(here, self._names.wait_s((name,), now))

    def failed(self, address: str, name: str, now: float) -> None:
        """Count a wrong password for this address, this name, and the pair. now: monotonic time, s."""
        self._both.add((address, name), now)
        self._addresses.add((address,), now)
        self._names.add((name,), now)

    def succeeded(self, address: str, name: str) -> None:
        """Record a right password, and clear the count of wrong passwords for this name at this address.

        From then on, wrong passwords for this name at other addresses do not delay this name at this address.
        """
        self._both.clear((address, name))
        self._right[address, name] = None
        self._right.move_to_end((address, name))
        while len(self._right) > REMEMBERED:
            self._right.popitem(last=False)


class _Owed:
    """Waiting time owed per key: each wrong password adds to it, and it expires by itself."""

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

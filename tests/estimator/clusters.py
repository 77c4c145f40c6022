"""Some estimators in one world, told of each other late, or not at all, or wrongly."""

from bridge.wire.messages import Holding, Owned
from estimator.service.cluster import Cluster, ClusterKnobs
from estimator.service.ownership import owner

KNOBS = ClusterKnobs(
    settle_s=1.0,
    return_s=1.0,
    hangs_s=2.5,
    hangs_most_s=4.0,
    fresh_s=0.0,
    retry_s=3.0,
    retry_most_s=12.0,
    at_once_s=6.0,
    calm_s=30.0,
    busy_s=20.0,
)
DEVICES = [f"d{number:02d}" for number in range(60)]


class World:
    """A clock, and who hears whom."""

    def __init__(self, *names: str) -> None:
        self.now = 0.0
        self.all: dict[str, Cluster] = {}
        self.cut: set[frozenset[str]] = set()
        #: devices that are being calibrated by whoever has them
        self.busy: set[str] = set()
        for name in names:
            self.start(name)

    def start(self, name: str) -> Cluster:
        self.all[name] = made = Cluster(name, [other for other in self.all if other != name], self.now, KNOBS)
        for other in self.all.values():
            other.change(name, self.now, alive=True)
        return made

    def kill(self, name: str) -> None:
        del self.all[name]
        for other in self.all.values():
            other.change(name, self.now, alive=False)

    def run(self, seconds: float, still: str = "") -> None:
        """Every 0.1 s each looks, takes what it wants of all devices, and says what it has."""
        for _ in range(round(seconds / 0.1)):
            self.now += 0.1
            for name, one in self.all.items():
                if name != still:
                    one.look(self.now)
                    for device in DEVICES:
                        if device not in one.held and one.wants(device, self.now):
                            one.take(device, round(self.now * 1e9))
                    self.say(name)

    def say(self, name: str) -> None:
        one = self.all[name]
        holdings = tuple(Holding(d, e, 0, 0, d in self.busy) for d, e in one.held.items())
        said = Owned(name, 0, one.highest, 0.0, holdings)
        for other in self.all.values():
            if other is not one and frozenset((name, other.own)) not in self.cut:
                for device in other.said(said, self.now):
                    other.lose(device, other.taker(name), self.now)

    def part(self, one: str, other: str, *, cut: bool) -> None:
        (self.cut.add if cut else self.cut.discard)(frozenset((one, other)))
        self.all[one].change(other, self.now, alive=not cut)
        self.all[other].change(one, self.now, alive=not cut)

    def assert_shared(self) -> None:
        """Each device has one estimator: the one it is to have."""
        for name, one in self.all.items():
            assert set(one.held) == {d for d in DEVICES if owner(d, list(self.all)) == name}, name

    def most(self) -> dict[str, str]:
        """Who is listened to, by device: the highest epoch."""
        return {d: max(self.all.values(), key=lambda one: one.held.get(d, -1)).own for d in DEVICES}

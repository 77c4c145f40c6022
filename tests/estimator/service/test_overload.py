"""An estimator with more devices than it can follow says so, and what to do; it stays ready, and says when it is over."""

import pytest

from bridge.reasons.codes import Code
from estimator.device.batch_correction import Cut
from estimator.device.outcome import Outcome
from estimator.device.session import DeviceSession
from estimator.overview import summary
from estimator.samples.sample_buffer import Samples
from estimator.service import overload
from estimator.service.health import ServiceHealth
from estimator.service.overload import BUSY, OVER_S, OVERLOADED, PERSISTS_S
from tests.estimator.served import Before, Served
from tests.estimator.stream import NAME, calibration


class Waiting(Before):
    """Who waits for messages lets time pass."""

    def __init__(self, served: Served) -> None:
        super().__init__()
        self._served = served

    def drain(self, limit: int, timeout_s: float):  # type: ignore[no-untyped-def]
        found = super().drain(limit, timeout_s)
        self._served.now += 0.0 if found else timeout_s
        return found


def test_a_slow_service_says_so_wherever_one_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    served = Served()
    served.raw = Waiting(served)
    handle, batches = DeviceSession.take, calibration(seed=1).batches()

    def slow(self: DeviceSession, samples: Samples, cuts: list[Cut]) -> Outcome | None:
        served.now += 0.4
        return handle(self, samples, cuts)

    with served:
        vitals = ServiceHealth(expects=True, clock=lambda: served.now)
        served.service._stock._vitals = vitals
        monkeypatch.setattr(DeviceSession, "take", slow)

        def busy() -> float:
            [ratio] = [f for f in vitals.families() if f.name == "busy_ratio"]
            return ratio.values[()]

        for at in range(0, 80, 4):
            for batch in batches[at : at + 4]:
                served.put(batch)
            served.service.step(0.05)
        device = served.service._devices[NAME]
        assert device.latest is not None
        assert device.latest.events[OVERLOADED] >= PERSISTS_S
        assert busy() > BUSY
        assert vitals.unready() == []
        seen = summary.summarise("w", {NAME: device.latest}, {}, ["bridge"], ["e"])
        assert not seen.well
        assert [one for one in seen.troubles if one.code == Code.ESTIMATOR_OVERLOADED] == overload.found(
            [device.latest]
        )
        assert served.service.counts.as_dict()[f"{OVERLOADED}, seconds"] > PERSISTS_S
        for _ in range(round((OVER_S + 3) / 0.05)):
            served.service.step(0.05)
        assert OVERLOADED not in device.latest.events
        assert busy() < 0.1

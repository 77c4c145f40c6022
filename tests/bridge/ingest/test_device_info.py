"""The account of a device is told at a boot, soon after news, once a second; and only then has to be made."""

import numpy as np

from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.ingest.device_info import News
from bridge.ingest.device_thread import Taken
from bridge.ingest.intake import Intake
from bridge.ingest.pump import DevicePublisher
from bridge.reasons.codes import Sentences
from bridge.wire import codec, keys
from bridge.wire.messages import DeviceInfo
from tests.sentences import free

START_S = 100.0


def info(time_s: float, boot: int, gaps: int, trouble: Sentences = ()) -> DeviceInfo:
    intake = Intake("d1", "b1", "scripted", "script")
    told = intake.info(round(time_s * 1e9), {"gaps": gaps}, trouble or free("none"))
    return DeviceInfo(**{name: getattr(told, name) for name in told.__slots__} | {"boot": boot})


def news(told: DeviceInfo) -> News:
    return News(told.dropped, told.events, told.trouble)


def test_news_wait_a_moment_and_everything_else_a_second() -> None:
    with MemoryBus(MemoryBroker()) as bus:
        outlet = DevicePublisher(bus, "w", "b1", "d1", 1)
        first, later = info(START_S, 7, 0), info(START_S, 7, 1)
        assert outlet.wants(START_S, 7, news(first))
        outlet.publish(Taken([], 7, True, first), START_S)
        for after_s, nothing, gap, boot in [
            (0.1, False, False, True),
            (0.3, False, True, True),
            (0.9, False, True, True),
            (1.1, True, True, True),
        ]:
            assert outlet.wants(START_S + after_s, 7, news(first)) is nothing
            assert outlet.wants(START_S + after_s, 7, news(later)) is gap
            assert outlet.wants(START_S + after_s, 8, news(first)) is boot


def test_whoever_makes_only_what_is_wanted_says_the_same() -> None:
    broker, rng = MemoryBroker(), np.random.default_rng(1)
    with MemoryBus(broker) as bus:
        heard = [bus.subscribe(keys.pattern(ward, "info")) for ward in ("all", "wanted")]
        outlets = [DevicePublisher(bus, ward, "b1", "d1", 1) for ward in ("all", "wanted")]
        time_s, boot, gaps = START_S, 7, 0
        made = 0
        for _ in range(2000):
            time_s += rng.uniform(0, 0.08)
            boot += rng.random() < 0.02
            gaps += rng.random() < 0.05
            told = info(time_s, boot, gaps)
            wanted = outlets[1].wants(time_s, boot, news(told))
            made += wanted
            outlets[0].publish(Taken([], boot, True, told), time_s)
            outlets[1].publish(Taken([], boot, True, told if wanted else None), time_s)
        said = [[repr(codec.decode_info(*message)) for message in each.drain(10_000, 0.1)] for each in heard]
    assert said[0] == said[1]
    assert 100 < made == len(said[0]) < 1000

"""A device that is turned by a scripted hand, the session that judges it, and what the guide told meanwhile."""

from collections.abc import Callable, Iterable

from bridge.sim.motion_scripts import SessionPlan, TurnPlan
from bridge.wire.messages import SampleBatch
from estimator.device.session import DeviceSession
from estimator.guide.guide import Guide
from estimator.guide.steps import Instruction
from tests.estimator.stream import Stream, calibration, feed

#: samples of a batch, as a bridge sends them
BATCH = 10


def turned(*turns: TurnPlan, seed: int = 1, before_s: float = 1.5, rests_s: float = 3.4) -> Stream:
    """Still, turn, still … still."""
    return calibration(seed=seed, before_s=before_s, plan=SessionPlan(rests_s, turns, (4.0, 5.0), 1.0, 2.0, 0.1))


def batches(stream: Stream, boot: int = 1) -> list[SampleBatch]:
    return stream.batches(range(BATCH, len(stream), BATCH), boot=boot)


def follow(
    guide: Guide,
    session: DeviceSession,
    sent: Iterable[SampleBatch],
    meanwhile: Callable[[float], None] = lambda _: None,
) -> list[Instruction]:
    """What is told after each batch; `meanwhile` gets the device's time and may ask for something."""
    told = []
    for batch in sent:
        feed(session, [batch])
        guide.take_samples(batch)
        meanwhile(float(batch.device_time[-1]))
        guide.take_status(session.status(batch.receive_time_ns))
        told.append(guide.told())
    return told


def steps(told: Iterable[Instruction]) -> list[str]:
    """The steps in order, each once while it lasts."""
    found: list[str] = []
    for one in told:
        if not found or found[-1] != one.step:
            found.append(one.step.value)
    return found

"""`truerate reload` waits for each program by itself, and for a busy one until it has read the file."""

from bridge.bus.contract import Reply
from bridge.bus.routers import Routers
from bridge.reasons.codes import Code
from bridge.wire import control_messages, keys
from bridge.wire.messages import CommandReply
from estimator.cli.reload import asked
from estimator.config.schema import Ward
from tests.memory_bus import MemoryBroker, MemoryBus


def test_a_program_without_a_file_takes_no_time_from_one_that_is_late() -> None:
    bus = MemoryBus(broker := MemoryBroker())
    times = 0

    def late(_: str, __: bytes, reply: Reply) -> None:
        nonlocal times
        times += 1
        digest = "new" if times > 3 else "old"
        reply(control_messages.encode_reply(CommandReply(digest, accepted=True, message=(Code.WARD_FILE_IN_FORCE(),))))

    alive = [
        bus.declare_alive(keys.build("w", "alive/bridge", bridge="a-playback")),
        bus.declare_alive(keys.build("w", "alive/estimator", estimator="e")),
        bus.answer(keys.build("w", "config", role="estimator", name="e"), late),
    ]
    found = dict(asked(MemoryBus(broker), Routers(()), Ward(ward="w"), "new", 2.0))
    assert [(member.name, reply.request_id) for member, reply in found.items()] == [("e", "new")]
    assert alive

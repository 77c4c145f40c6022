"""Caches over zenoh: what is asked of them and how, and hostile questions, answers and messages."""

from collections.abc import Iterator

import pytest
import zenoh

from bridge.bus import gap_repair
from bridge.bus.contract import Bus
from tests.bridge.bus.worlds import ZenohWorld, collect, eventually, meet, numbers, settled


@pytest.fixture
def world() -> Iterator[ZenohWorld]:
    made = ZenohWorld()
    yield made
    made.stop()


@pytest.fixture
def stranger(world: ZenohWorld) -> Iterator[zenoh.Session]:
    """A program of somebody else's that knows zenoh and what docs/wire.md says."""
    config = f'{{mode: "client", connect: {{endpoints: ["{world._endpoint}"]}}}}'
    with zenoh.open(zenoh.Config.from_json5(config)) as session:
        yield session


def asked(session: zenoh.Session, question: str) -> list[tuple[str, bytes, bytes]]:
    replies = session.get(
        question,
        zenoh.handlers.FifoChannel(1000),
        accept_replies=zenoh.ReplyKeyExpr.ANY,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=90.0,
    )
    ok = [reply.ok for reply in replies if reply.ok is not None]
    return [(str(s.key_expr), s.payload.to_bytes(), s.attachment.to_bytes() if s.attachment else b"") for s in ok]


def test_another_program_gets_the_past_as_the_wire_document_says(a: Bus, stranger: zenoh.Session) -> None:
    heard = stranger.declare_subscriber("t/x/*", zenoh.handlers.FifoChannel(100))
    first_of_all = a.publisher("t/x/0")

    def known() -> bool:
        first_of_all.put(b"?")
        return heard.try_recv() is not None

    eventually(known)
    while heard.try_recv() is not None:
        pass
    publishers = [a.publisher(key, cache=5) for key in ("t/x/1", "t/x/2")]
    for publisher in publishers:
        for n in range(8):
            publisher.put(b"%d" % n)
    while (first := heard.recv()).payload.to_bytes() == b"?":
        pass
    assert first.attachment is not None
    stamp = first.attachment.to_bytes()
    assert (len(stamp), int.from_bytes(stamp[12:], "big")) == (20, 0)
    found = asked(stranger, "t/x/*/@adv/*")
    assert sorted((key, payload) for key, payload, _ in found) == [
        (key, b"%d" % n) for key in ("t/x/1", "t/x/2") for n in range(3, 8)
    ]
    publisher_number = int.from_bytes(stamp[8:12], "big")
    from_six = asked(stranger, f"t/x/1/@adv/{stamp[:8].hex()}?publisher={publisher_number};from=6")
    assert [(payload, attachment) for _, payload, attachment in from_six] == [
        (b"%d" % n, stamp[:12] + n.to_bytes(8, "big")) for n in (6, 7)
    ]
    assert [payload for _, payload, _ in asked(stranger, "t/x/2/@adv/*?most=2")] == [b"6", b"7"]

    def both_have_just_sent() -> bool:
        for publisher in publishers:
            publisher.put(b"8")
        return asked(stranger, "t/x/*/@adv/*?last=60") == []

    eventually(both_have_just_sent)  # the machine may pause before the question
    eventually(lambda: len(asked(stranger, "t/x/*/@adv/*?last=60")) == 2)


def test_strange_questions_end_and_harm_nothing(a: Bus, stranger: zenoh.Session) -> None:
    publisher = a.publisher("t/x/1", cache=5)
    for n in range(5):
        publisher.put(b"%d" % n)
    for pattern in ("t/x/1", "t/**", "**", "t/$*x/1", "t/x/none"):
        for what in ("most=x", "most=-1", "publisher=0", "publisher=zz;from=1", "from=", "last=nan", "what=ever", ""):
            asked(stranger, f"{pattern}/@adv/*?{what}")
    late = a.subscribe("t/x/*", history=True)
    assert numbers(collect(late, 5)) == list(range(5))


def test_strange_attachments_harm_nothing(a: Bus, b: Bus, stranger: zenoh.Session) -> None:
    subscription, publisher = b.subscribe("t/*", history=True), a.publisher("t/one", cache=9)
    meet(publisher, subscription)
    for stamp in (b"", b"1", bytes(19), bytes(21), b"\xff" * 20, b"\xff" * 3000):
        for key in ("t/one", "t/other", "t/*", "t/**"):
            stranger.put(key, b"strange", attachment=stamp)
    publisher.put(b"1")
    publisher.put(b"2")
    came: list[bytes] = []
    while b"2" not in came and (message := subscription.receive(30.0)) is not None:
        came.append(message.payload)
    assert [payload for payload in came if payload != b"strange"] == [b"1", b"2"]


def test_a_borrowed_identity_under_another_key_takes_no_numbers_away(a: Bus, b: Bus, stranger: zenoh.Session) -> None:
    subscription, publisher = b.subscribe("t/*", history=True), a.publisher("t/one", cache=9)
    heard = stranger.declare_subscriber("t/one", zenoh.handlers.FifoChannel(100))
    meet(publisher, subscription)
    attachment = heard.recv().attachment
    assert attachment is not None
    last = int.from_bytes(attachment.to_bytes()[12:], "big")
    for n in range(last, last + 50):
        stranger.put("t/two", b"forged", attachment=attachment.to_bytes()[:12] + n.to_bytes(8, "big"))
    for n in range(5):
        publisher.put(b"%d" % n)
    came = list[bytes]()

    def five() -> bool:
        came.extend(m.payload for m in subscription.drain(100, 0.0) if m.key == "t/one")
        return len(came) >= 5

    eventually(five)
    assert came == [b"%d" % n for n in range(5)]


def test_a_question_that_never_ends_keeps_nothing_waiting_for_ever(
    world: ZenohWorld, monkeypatch: pytest.MonkeyPatch, stranger: zenoh.Session
) -> None:
    monkeypatch.setattr(gap_repair, "_OVER_S", 0.3)
    kept = stranger.declare_queryable("t/*/@adv/mine", zenoh.handlers.FifoChannel(100))
    questions = list[zenoh.Query]()
    with world.bus() as a, world.bus() as b:
        publisher, subscription = a.publisher("t/one", cache=9), b.subscribe("t/*", history=True)
        publisher.put(b"1")
        eventually(lambda: subscription.caught_up)
        assert numbers(collect(subscription, 1)) == [1]

        def asked_for_ever() -> bool:
            while (query := kept.handler.try_recv()) is not None:
                questions.append(query)
            return bool(questions)

        eventually(asked_for_ever)
    for query in questions:
        query.drop()  # type: ignore[no-untyped-call]


def test_two_publishers_of_one_key_are_each_heard_once(a: Bus, b: Bus) -> None:
    first, second = a.publisher("t/one", cache=50), b.publisher("t/one", cache=50)
    for n in range(10):
        first.put(b"%d" % n)
        second.put(b"%d" % (100 + n))
    subscription = a.subscribe("t/one", history=True)
    eventually(lambda: subscription.caught_up)
    for n in range(10, 20):
        first.put(b"%d" % n)
        second.put(b"%d" % (100 + n))
    came = numbers(collect(subscription, 40))
    assert [n for n in came if n < 100] == list(range(20))
    assert [n for n in came if n >= 100] == list(range(100, 120))


def test_a_closed_publisher_is_not_answered_for(a: Bus, b: Bus) -> None:
    gone, there = a.publisher("t/gone", cache=5), a.publisher("t/there", cache=5)
    gone.put(b"1")
    there.put(b"2")
    gone.close()
    settled(a, b)  # what is still under way would come as news
    subscription = b.subscribe("t/*", history=True)
    assert numbers(collect(subscription, 1)) == [2]

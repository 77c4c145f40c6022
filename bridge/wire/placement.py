"""Placement of a device on a wearer: validation, and encoding inside other messages."""

from bridge.wire import truerate_pb2 as pb
from bridge.wire import validation
from bridge.wire.messages import SEGMENTS, SIDES, Placement
from bridge.wire.refusal import Reason, Refusal

#: most characters of a bed or pseudonym
MAX_WEARER = 32


def placement(segment: str = "", side: str = "", wearer: str = "", since_ns: int = 0, who: str = "") -> Placement:
    """Validate the fields of a Placement and build it; spaces around `wearer` are removed.

    since_ns: ns since the Unix epoch. Raises Refusal, with the accepted values, for an unknown segment or side, a side
    that the segment lacks, and an invalid text or time.
    """
    if segment and segment not in SEGMENTS:
        raise Refusal(Reason.RANGE, f"unknown segment {segment[:32]!r}: use {', '.join(SEGMENTS)}")
    if side and side not in SIDES:
        raise Refusal(Reason.RANGE, f"unknown side {side[:32]!r}: use {' or '.join(SIDES)}")
    if side and not SEGMENTS.get(segment, False):
        paired = ", ".join(name for name, both in SEGMENTS.items() if both)
        raise Refusal(
            Reason.RANGE, f"{segment or 'no segment'} has no {side} side: leave the side out, or use {paired}"
        )
    named = validation.text(wearer, "wearer", MAX_WEARER).strip()
    if wearer and not named:
        raise Refusal(Reason.RANGE, "wearer is only spaces: give a bed or a pseudonym, such as bed-3 or P07")
    return Placement(segment, side, named, validation.time_ns(since_ns, "since_ns"), validation.text(who, "who"))


def placement_message(one: Placement) -> pb.Placement:
    """Convert a Placement to its protobuf message."""
    who = validation.clean(one.who, validation.MAX_NAME)
    return pb.Placement(segment=one.segment, side=one.side, wearer=one.wearer, since_ns=one.since_ns, who=who)


def placement_in(raw: pb.Status | pb.Checkpoint | pb.Command) -> Placement | None:
    """Validate the placement inside a received message and convert it; None if the message has none.

    Raises Refusal if the placement is invalid.
    """
    if not raw.HasField("placement"):
        return None
    said = raw.placement
    return placement(said.segment, said.side, said.wearer, said.since_ns, said.who)

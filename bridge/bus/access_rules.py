"""Access rules per role, as zenoh's access control takes them: everything is denied but what stands here. Pure.

zenoh tells a holder by the common name of its certificate, exactly: each is named. What it denies it denies silently, and a
subscription wider than what is allowed gets nothing. Of a key that an advanced publisher has, `KEY/@adv/**` carries its
heartbeats, its history and, where others than ours publish, the news that it is there; `**` does not match it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from bridge.pki.member import Member, Role
from bridge.wire import keys

PUBLISHED = ("corrected", "status", "calibration", "revision", "note", *keys.BY_NAME)
TOKENS = ("alive/device", "alive/bridge", "alive/estimator")

# What tells a holder's words, and what asks for words. From a holder is a router's ingress, to it the router's egress.
_WORDS = ("put", "delete", "reply", "liveliness_token")
_ASKING = ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query")


@dataclass(frozen=True, slots=True)
class Rights:
    """Key patterns of one member: what it says, what it hears, what it commands, and what commands it obeys."""

    says: tuple[str, ...] = ()
    hears: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()
    answers: tuple[str, ...] = ()


def rights(ward: str, member: Member) -> Rights:
    """Rights of a member of a ward; each member may also declare a token of its own, for the self test."""
    given = _rights(ward, member)
    probe = (keys.build(ward, "alive/probe", role=member.role.value, name=member.name),)
    return replace(given, says=given.says + probe, hears=given.hears + probe)


def _rights(ward: str, member: Member) -> Rights:
    own = member.name

    def all_of(*whats: str) -> tuple[str, ...]:
        return tuple(keys.pattern(ward, what) for what in whats)

    match member.role:
        case Role.BRIDGE:
            return Rights(
                says=(
                    keys.pattern(ward, "raw", bridge=own),
                    keys.pattern(ward, "info", bridge=own),
                    keys.build(ward, "alive/bridge", bridge=own),
                    keys.pattern(ward, "alive/device"),
                ),
                hears=all_of("status", "alive/bridge"),
            )
        case Role.ESTIMATOR:
            return Rights(
                says=(
                    *all_of(*PUBLISHED, "checkpoint"),
                    keys.build(ward, "owned", estimator=own),
                    keys.build(ward, "alive/estimator", estimator=own),
                ),
                hears=all_of("raw", "info", "owned", "checkpoint", *TOKENS),
                answers=all_of("rpc"),
            )
        case Role.VIEWER:
            return Rights(hears=all_of("info", "owned", *PUBLISHED, *TOKENS))
        case Role.COMMANDER:
            return Rights(hears=all_of("raw", "info", "owned", *PUBLISHED, *TOKENS), asks=all_of("rpc"))
        case Role.RECORDER:
            return Rights(hears=(keys.everything(ward),))
        case Role.ROUTER:
            everything = (keys.everything(ward), *all_of(*keys.BY_NAME))
            return Rights(says=everything, hears=everything, asks=everything, answers=everything)


def access_control(places: Sequence[tuple[str, Member]]) -> dict[str, Any]:
    """A router's `access_control`: who has the rights of its role in which ward."""
    rules: dict[str, list[dict[str, Any]]] = {}
    for ward, member in places:
        rules.setdefault(member.common_name, []).extend(_rules(ward, member))
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for made in rules.values() for rule in made],
        "subjects": [{"id": name, "cert_common_names": [name]} for name in rules],
        "policies": [{"rules": [rule["id"] for rule in made], "subjects": [name]} for name, made in rules.items()],
    }


def _rules(ward: str, member: Member) -> list[dict[str, Any]]:
    given, name = rights(ward, member), member.common_name
    said, heard = (patterns + _history(patterns) for patterns in (given.says, given.hears))
    # zenoh allows a question only where it is no wider than the rule, and questions to all of a ward are wide.
    by_name = (keys.pattern(ward, what) for what in keys.BY_NAME)
    anything = (keys.everything(ward), f"{keys.everything(ward)}/@adv/**", *by_name)
    rows = (
        ("says", "ingress", _WORDS, said),
        ("keeps what it said", "ingress", ("declare_queryable",), _history(given.says)),
        ("is asked for it", "egress", (*_ASKING, "query"), anything if said else ()),
        ("hears", "egress", _WORDS, heard),
        ("hears of histories", "egress", ("declare_queryable",), _history(given.hears)),
        ("asks to hear", "ingress", _ASKING, heard),
        ("asks for histories", "ingress", ("query",), _history(given.hears)),
        ("commands", "ingress", ("query",), given.asks),
        ("is obeyed", "egress", ("reply", "declare_queryable"), given.asks),
        ("obeys", "ingress", ("reply", "declare_queryable"), given.answers),
        ("is commanded", "egress", ("query",), given.answers),
    )
    return [
        {
            "id": f"{name} {what} ({ward})",
            "permission": "allow",
            "flows": [flow],
            "messages": list(messages),
            "key_exprs": list(patterns),
        }
        for what, flow, messages, patterns in rows
        if patterns
    ]


def _history(patterns: tuple[str, ...]) -> tuple[str, ...]:
    """Where advanced publishers keep what they said; a token has no history."""
    return tuple(f"{pattern}/@adv/**" for pattern in patterns if "/alive/" not in pattern)

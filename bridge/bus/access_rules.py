"""Access rules for a zenoh router: which bus keys each role may publish, subscribe to and query. No I/O.

Everything without a rule is denied. Only a program with the role `commander` may start a recalibration. The dashboard
has this role on the bus and acts for its users; see docs/security.md.

A member is a program with a certificate. zenoh identifies it by the exact common name of the certificate, so the rules
name every member. zenoh denies silently: a subscription wider than its rule receives nothing.

If the publisher of a key KEY has a cache, it answers queries on keys `KEY/@adv/**`. Advanced publishers of other zenoh
programs also announce themselves and send heartbeats on these keys. The wildcard `**` does not match the part `@adv` of
a key, so the rules name these keys as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from bridge.pki.member import Member, Role
from bridge.ros.names import key_patterns
from bridge.wire import keys

PUBLISHED = ("corrected", "orientation", "status", "calibration", "revision", "note", *keys.BY_NAME)
TOKENS = ("alive/device", "alive/bridge", "alive/estimator")

# zenoh message kinds that carry data, and kinds that request data. Ingress is from a member into the router; egress is back.
_WORDS = ("put", "delete", "reply", "liveliness_token")
_ASKING = ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query")


@dataclass(frozen=True, slots=True)
class Rights:
    """Bus keys that one member (a program with a certificate) may use. Each field is a tuple of key patterns.

    says: keys to publish. hears: keys to subscribe to. asks: keys to send queries to. answers: keys on which to answer
    queries.
    """

    says: tuple[str, ...] = ()
    hears: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()
    answers: tuple[str, ...] = ()


def rights(ward: str, member: Member) -> Rights:
    """Return the bus keys that a member of a ward may use, according to the member's role.

    In addition, each member may publish and see its own liveliness token for the self-test of access rules. Each member
    may also send and answer queries on its own key for the ward-file settings in force.
    """
    given = _rights(ward, member)
    probe, file = (
        (keys.build(ward, what, role=member.role.value, name=member.name),) for what in ("alive/probe", "config")
    )
    return replace(
        given,
        says=given.says + probe,
        hears=given.hears + probe,
        asks=tuple(dict.fromkeys(given.asks + file)),
        answers=given.answers + file,
    )


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
            return Rights(hears=all_of("raw", "info", "owned", *PUBLISHED, *TOKENS), asks=all_of("rpc", "config"))
        case Role.ROS2:
            topics = key_patterns(ward)
            return Rights(says=topics, hears=(*all_of("raw", "info", "owned", *PUBLISHED, *TOKENS), *topics))
        case Role.PAGE:
            return Rights()  # its certificate is for browsers
        case Role.RECORDER:
            return Rights(hears=(keys.everything(ward),))
        case Role.ROUTER:
            everything = (keys.everything(ward), *all_of(*keys.BY_NAME))
            return Rights(says=everything, hears=everything, asks=everything, answers=everything)


def access_control(places: Sequence[tuple[str, Member]]) -> dict[str, Any]:
    """Build the section `access_control` of a router's zenoh configuration file, a dict with zenoh's keys.

    Everything that no rule allows is denied. places: pairs (ward, member); one member may appear in several wards.
    """
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
    # zenoh allows a query only if the query is no wider than its rule, and a query to a whole ward is wide.
    by_name = (keys.pattern(ward, what) for what in keys.BY_NAME)
    outside = (pattern for pattern in given.says if not pattern.startswith(keys.ROOT))  # of ROS 2
    anything = (keys.everything(ward), f"{keys.everything(ward)}/@adv/**", *by_name, *outside)
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
    """Return the history keys of advanced publishers for these patterns; liveliness tokens have no history."""
    return tuple(f"{pattern}/@adv/**" for pattern in patterns if "/alive/" not in pattern)

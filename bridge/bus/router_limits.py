"""What a router's settings would let fall, whom they shut out, and whom one slow reader holds up. Pure."""

from collections.abc import Iterator
from typing import Any

from bridge.bus import zenoh_settings
from bridge.wire import keys
from bridge.wire.envelope import MAX_PAYLOAD

_OURS_US = round(zenoh_settings.CUT_OFF_S * 1e6)
#: so many times as long, or as large, is not complained of: files of earlier truerates say so
_BEARABLE = 2
#: nor is what is so many times as short
_HASTY = 10
#: so many may be about to connect at once, at least
_PENDING = 100
#: signs of life in a lease
_SIGNS = range(2, 101)


def faults(said: dict[str, Any]) -> Iterator[str]:
    """Each a sentence that begins with the setting."""
    yield from _of_what_is_lost(said)
    yield from _of_who_is_shut_out(said["transport"])
    yield from _of_what_is_held_up(said["transport"]["link"])


def _of_what_is_lost(said: dict[str, Any]) -> Iterator[str]:
    if said["namespace"]:
        yield f"namespace is {said['namespace']!r}: all would go under keys that nobody reads: leave it out"
    if said["downsampling"]:
        yield "downsampling: samples would be lost, silently: leave it out"
    small = [one["size_limit"] for one in said["low_pass_filter"] if one["size_limit"] < MAX_PAYLOAD]
    if small:
        yield f"low_pass_filter: size_limit is {small[0]}: what is larger is lost, silently; ours is {MAX_PAYLOAD}"
    shed = [set(one["key_exprs"]) for one in said["qos"]["network"] if _sheds(one)]
    if kept := [key for key in keys.VIEWED if not any(key in those for those in shed)]:
        yield f"qos.network: on {', '.join(kept)} a slow viewer holds up all others; `truerate pki router` writes it"
    if len(shed) < len(said["qos"]["network"]):
        yield "qos.network: a rule that is not ours, by which samples may be lost, silently: leave it out"


def _sheds(one: dict[str, Any]) -> bool:
    """Whether a rule is ours: to whoever is slow, what people look at is dropped, and nothing else."""
    ours = zenoh_settings.shedding(keys.VIEWED)
    there = {name: value for name, value in one.items() if value and name != "id"}
    there["overwrite"] = {name: value for name, value in one["overwrite"].items() if value is not None}
    of = set(there.get("key_exprs", ()))
    return bool(of) and of <= set(ours["key_exprs"]) and there | {"key_exprs": ours["key_exprs"]} == ours


def _of_who_is_shut_out(transport: dict[str, Any]) -> Iterator[str]:
    unicast = transport["unicast"]
    accept_ms = round(zenoh_settings.ACCEPT_S * 1000)
    shortest_ms, longest_ms = accept_ms // _HASTY, accept_ms * _BEARABLE
    if unicast["accept_timeout"] > longest_ms or unicast["accept_pending"] < _PENDING:
        yield (
            f"accept_timeout is {unicast['accept_timeout']} ms, accept_pending {unicast['accept_pending']}: connections that say"
            f" nothing lock others out; at most {longest_ms} and at least {_PENDING}"
        )
    if unicast["accept_timeout"] < shortest_ms:
        yield f"accept_timeout is {unicast['accept_timeout']} ms: nobody shows a certificate so fast; {accept_ms} is ours"
    if (most := unicast["max_sessions"]) < _PENDING:
        yield f"max_sessions is {most}: who comes after so many is not let in; {_PENDING} at least"
    if any(value for kind in transport["auth"].values() for value in kind.values()):
        yield "transport.auth: nobody of a ward has passwords or keys for it, and none is let in: leave it out"
    if unicast["lowlatency"]:
        yield "transport.unicast.lowlatency must be false: no router starts with it beside qos"


def _of_what_is_held_up(link: dict[str, Any]) -> Iterator[str]:
    tx = link["tx"]
    waits = tx["queue"]["congestion_control"]
    wait_us, drop_us = waits["block"]["wait_before_close"], waits["drop"]["wait_before_drop"]
    if drop_us > _OURS_US:
        yield f"wait_before_drop is {drop_us} µs: a slow viewer holds up all others for so long; at most {_OURS_US}"
    if wait_us > _BEARABLE * _OURS_US:
        yield f"wait_before_close is {wait_us} µs: one frozen reader silences a ward for so long; {_OURS_US} is ours"
    if wait_us < _OURS_US // _HASTY:
        yield f"wait_before_close is {wait_us} µs: who is busy for a moment is cut off; {_OURS_US} is ours"
    shortest_ms, longest_ms = (
        round(1000 * s) for s in (zenoh_settings.ROUTER_LEASE_S, _BEARABLE * zenoh_settings.NETWORK_LEASE_S)
    )
    if not shortest_ms <= (lease_ms := tx["lease"]) <= longest_ms:
        yield (
            f"lease is {lease_ms} ms: who says nothing for so long is taken for gone, whoever hangs is not before;"
            f" {shortest_ms} to {longest_ms} is sensible"
        )
    if tx["keep_alive"] not in _SIGNS:
        yield (
            f"keep_alive is {tx['keep_alive']}: so many signs of life are given in a lease; {zenoh_settings.SIGNS} is ours,"
            f" {_SIGNS[0]} to {_SIGNS[-1]} is sensible"
        )
    if (most := link["rx"]["max_message_size"]) < MAX_PAYLOAD:
        yield f"max_message_size is {most}: what is larger would be lost; messages have up to {MAX_PAYLOAD} bytes"
    if most > _BEARABLE * zenoh_settings.MAX_MESSAGE_BYTES:
        yield (
            f"max_message_size is {most}: so much memory whoever is let in can take, each; {zenoh_settings.MAX_MESSAGE_BYTES}"
            " is ours"
        )

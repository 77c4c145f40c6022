"""The settings of zenoh sessions: explicit endpoints only, quick to notice a loss and to come back."""

from collections.abc import Sequence
from typing import Any

from bridge.pki.certificate_files import Identity
from bridge.wire.envelope import MAX_PAYLOAD
from bridge.wire.keys import BY_NAME, ROOT

# A router disconnects a reader that takes nothing for this long, its buffers being full; until then it holds up everybody it is
# published to by the same sender: measured, the hole they hear is this long and a few ms.
CUT_OFF_S = 0.1
# Longer in clients, or they would leave a router that is only waiting for such a reader.
CLIENT_CUT_OFF_S = 1.0
# Who has been silent for its own lease is taken for gone. A process that ends is known at once, by its connection: a lease is
# for a machine that hangs or a cable that is pulled, and must outlast the moments in which a busy machine does not get round
# to a process. Clients: others must know within 1.5 s that an estimator hangs. The router: before its clients think that
# all devices are silent, after the 2 s of an estimator's `silence_s`.
CLIENT_LEASE_S, ROUTER_LEASE_S = 1.25, 1.5
# Over a network, where certificates are asked for, packets get lost, and TCP takes seconds to repeat what was lost twice. Who is
# given up meanwhile begins anew, with a handshake and all that it has missed: at 30 % loss it never ends. And what waits in the
# machine for its turn does not hold up others.
NETWORK_LEASE_S, NETWORK_BUFFER_BYTES = 5.0, 1 << 20
# So many signs of life in a lease: the more, the closer to all of it a process may be held up.
SIGNS = 10
# A handshake through a line that loses packets takes some repeats of the network's own, the first after a second. Longer for who
# connects, or a router that is cut off would be found again only as late as that: its first packet is repeated ever more seldom.
ACCEPT_S, OPEN_S = 2.0, 4.0
MAX_MESSAGE_BYTES = 1 << 20

Settings = dict[str, Any]


def client(endpoints: Sequence[str], identity: Identity | None = None) -> Settings:
    """A session that goes to the first router that answers, and looks for one again for ever once it had one."""
    waits = (CLIENT_CUT_OFF_S, CLIENT_LEASE_S) if identity is None else (NETWORK_LEASE_S, NETWORK_LEASE_S)
    settings = _common(*waits) | {
        "mode": "client",
        "connect": {
            "endpoints": list(endpoints),
            # Each endpoint once: with a time to spend, zenoh spends all of it on the first and never tries the second.
            "timeout_ms": 0,
            "exit_on_failure": True,
            "retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
        },
        "listen": {"endpoints": []},
    }
    if identity is not None:
        settings["transport"]["link"]["tls"] = _tls(identity, "connect")
    return settings


def router(listen: Sequence[str], shed: Sequence[str]) -> Settings:
    """A router; idle connections are dropped (SECURITY.md, T7), and on `shed` a slow reader loses instead of slowing others."""
    settings = _common(CUT_OFF_S, ROUTER_LEASE_S) | {
        "mode": "router",
        "connect": {"endpoints": []},
        "listen": {"endpoints": list(listen), "timeout_ms": 0, "exit_on_failure": True},
    }
    # With zenoh's own timestamps, its advanced subscribers, of other programs, take uncached messages that cross for old.
    settings["timestamping"] = {"enabled": False}
    settings["transport"]["unicast"] |= {"accept_timeout": round(ACCEPT_S * 1000), "accept_pending": 1000}
    if shed:
        settings["qos"] = {"network": [shedding(shed)]}
    return settings


def secured_router(
    listen: Sequence[str], shed: Sequence[str], identity: Identity, access_control: Settings, join: Sequence[str] = ()
) -> Settings:
    """A router that lets in who has a certificate, by TLS alone, and each to what `access_rules` allows."""
    settings = router(listen, shed)
    link = settings["transport"]["link"]
    link["tx"]["lease"] = round(NETWORK_LEASE_S * 1000)
    link["protocols"] = ["tls"]
    link["tls"] = _tls(identity, "listen") | _tls(identity, "connect")
    settings["access_control"] = access_control
    settings["low_pass_filter"] = [size_limit()]
    return joined(settings, join) if join else settings


def shedding(shed: Sequence[str]) -> Settings:
    """A router's rule: a reader that cannot keep up with these loses them, and holds up nobody."""
    return {
        # A cached publisher's heartbeats insist on being delivered, too.
        "key_exprs": [key for pattern in shed for key in (pattern, f"{pattern}/@adv/**")],
        "flows": ["egress"],
        "messages": ["put", "delete"],
        "overwrite": {"congestion_control": "drop"},
    }


def size_limit() -> Settings:
    """A router's filter: nothing larger than the largest message of the wire."""
    return {
        "id": "size",
        "flows": ["ingress"],
        "messages": ["put", "delete", "query", "reply"],
        # `**` does not match what begins with an @
        "key_exprs": ["**", f"{ROOT}/**", f"{ROOT}/**/@adv/**", *(f"{ROOT}/*/{what}/**" for what in BY_NAME)],
        "size_limit": MAX_PAYLOAD,
    }


def joined(settings: Settings, join: Sequence[str]) -> Settings:
    """A router that goes to others, which may start later, or be away for a night."""
    retry = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2}
    return settings | {"connect": {"endpoints": list(join), "timeout_ms": -1, "exit_on_failure": False, "retry": retry}}


def _tls(identity: Identity, as_: str) -> Settings:
    """Both sides show a certificate; one that has expired ends the connection that it opened."""
    return {
        "root_ca_certificate": identity.ca,
        f"{as_}_certificate": identity.certificate,
        f"{as_}_private_key": identity.key,
        "enable_mtls": True,  # without it a client does not show its own
        "so_sndbuf": NETWORK_BUFFER_BYTES,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }


def _common(cut_off_s: float, lease_s: float) -> Settings:
    # zenoh by itself listens on every interface and announces itself by multicast and gossip: not in a hospital.
    return {
        "scouting": {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}},
        # zenohd enables it whatever a file says; what may be seen of it stays as the file says
        "adminspace": {"enabled": False, "permissions": {"read": False, "write": False}},
        "transport": {
            "unicast": {"open_timeout": round(OPEN_S * 1000)},
            "link": {
                "tx": {
                    "lease": round(lease_s * 1000),
                    "keep_alive": SIGNS,
                    "queue": {"congestion_control": {"block": {"wait_before_close": round(cut_off_s * 1e6)}}},
                },
                "rx": {"max_message_size": MAX_MESSAGE_BYTES},
            },
            # Segments outlive a killed process, and large messages in them would pass by max_message_size.
            "shared_memory": {"enabled": False},
        },
    }

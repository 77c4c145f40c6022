"""zenoh settings of clients and routers: no automatic discovery, fast detection of lost peers, fast reconnection."""

from collections.abc import Sequence
from typing import Any

from bridge.pki.certificate_files import Identity
from bridge.wire.envelope import MAX_PAYLOAD
from bridge.wire.keys import BY_NAME, ROOT

# A router disconnects a reader that takes nothing for this long while its buffers are full. Until then the reader delays all
# other readers of the same sender: the measured gap is this long plus a few ms.
CUT_OFF_S = 0.1
# Longer in clients: otherwise a client would leave a router that is only waiting for such a reader.
CLIENT_CUT_OFF_S = 1.0
# A peer silent for its own lease counts as gone. The end of a process shows at once, by its connection. A lease detects a
# hung machine or a pulled cable, and must outlast the pauses of a process on a busy machine. Clients: a hung estimator must
# be known within 1.5 s. Router: its loss must be known before its clients take all devices for silent, after the 2 s of an
# estimator's `silence_s`.
CLIENT_LEASE_S, ROUTER_LEASE_S = 1.25, 1.5
# Over a network (with certificates) packets get lost, and TCP takes seconds to repeat a packet lost twice. A peer given up
# meanwhile needs a new handshake and all messages it missed: at 30 % loss that never ends. A larger send buffer keeps
# waiting data from delaying other readers.
NETWORK_LEASE_S, NETWORK_BUFFER_BYTES = 5.0, 1 << 20
# Keep-alive messages per lease: the more, the closer to the whole lease a process may pause.
SIGNS = 10
# A handshake over a lossy line takes some TCP repeats, the first after a second. The connecting side waits longer, because TCP
# repeats a first packet at growing intervals, which would delay finding a router again after it was cut off.
ACCEPT_S, OPEN_S = 2.0, 4.0
MAX_MESSAGE_BYTES = 1 << 20

Settings = dict[str, Any]


def client(endpoints: Sequence[str], identity: Identity | None = None) -> Settings:
    """Return zenoh settings for a client, which connects to the first router that answers and reconnects after any loss.

    endpoints: router endpoints, in order of preference. identity: paths of the certificate files for TLS; None without
    TLS.
    """
    waits = (CLIENT_CUT_OFF_S, CLIENT_LEASE_S) if identity is None else (NETWORK_LEASE_S, NETWORK_LEASE_S)
    settings = _common(*waits) | {
        "mode": "client",
        "connect": {
            "endpoints": list(endpoints),
            # Try each endpoint once: with a timeout, zenoh spends all of it on the first endpoint and never tries the second.
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
    """Return zenoh settings for a router that listens on the endpoints `listen`.

    The router closes a connection on which no zenoh session opens within ACCEPT_S (2) seconds (SECURITY.md, T7).
    shed: key patterns on which a slow reader loses messages instead of delaying other readers.
    """
    settings = _common(CUT_OFF_S, ROUTER_LEASE_S) | {
        "mode": "router",
        "connect": {"endpoints": []},
        "listen": {"endpoints": list(listen), "timeout_ms": 0, "exit_on_failure": True},
    }
    # With zenoh's timestamps, advanced subscribers of other programs discard uncached messages that overtake each other as old.
    settings["timestamping"] = {"enabled": False}
    settings["transport"]["unicast"] |= {"accept_timeout": round(ACCEPT_S * 1000), "accept_pending": 1000}
    if shed:
        settings["qos"] = {"network": [shedding(shed)]}
    return settings


def secured_router(
    listen: Sequence[str], shed: Sequence[str], identity: Identity, access_control: Settings, join: Sequence[str] = ()
) -> Settings:
    """Return zenoh settings for a router that accepts only TLS with a client certificate.

    listen, shed: as in `router`. identity: paths of the router's certificate files. access_control: zenoh's settings
    for access rules. join: endpoints of other routers to connect to.
    """
    settings = router(listen, shed)
    link = settings["transport"]["link"]
    link["tx"]["lease"] = round(NETWORK_LEASE_S * 1000)
    link["protocols"] = ["tls"]
    link["tls"] = _tls(identity, "listen") | _tls(identity, "connect")
    settings["access_control"] = access_control
    settings["low_pass_filter"] = [size_limit()]
    return joined(settings, join) if join else settings


def shedding(shed: Sequence[str]) -> Settings:
    """Return zenoh's quality-of-service rule by which slow readers lose messages on the key patterns `shed`.

    Without this rule, a slow reader would delay all others.
    """
    return {
        # Heartbeats of a publisher with a cache would block as well.
        "key_exprs": [key for pattern in shed for key in (pattern, f"{pattern}/@adv/**")],
        "flows": ["egress"],
        "messages": ["put", "delete"],
        "overwrite": {"congestion_control": "drop"},
    }


def size_limit() -> Settings:
    """Return zenoh's filter rule with which a router rejects every message larger than MAX_PAYLOAD bytes."""
    return {
        "id": "size",
        "flows": ["ingress"],
        "messages": ["put", "delete", "query", "reply"],
        # `**` does not match a chunk that begins with @
        "key_exprs": ["**", f"{ROOT}/**", f"{ROOT}/**/@adv/**", *(f"{ROOT}/*/{what}/**" for what in BY_NAME)],
        "size_limit": MAX_PAYLOAD,
    }


def joined(settings: Settings, join: Sequence[str]) -> Settings:
    """Return router settings with connections to other routers added.

    join: endpoints of the other routers. The connection is retried, so they may start later or be unreachable for
    hours.
    """
    retry = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2}
    return settings | {"connect": {"endpoints": list(join), "timeout_ms": -1, "exit_on_failure": False, "retry": retry}}


def _tls(identity: Identity, as_: str) -> Settings:
    """Mutual TLS; the connection ends when its certificate expires. as_: `connect` or `listen`."""
    return {
        "root_ca_certificate": identity.ca,
        f"{as_}_certificate": identity.certificate,
        f"{as_}_private_key": identity.key,
        "enable_mtls": True,  # otherwise a client does not send its certificate
        "so_sndbuf": NETWORK_BUFFER_BYTES,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }


def _common(cut_off_s: float, lease_s: float) -> Settings:
    # By default zenoh listens on every interface and announces itself by multicast and gossip: not in a hospital.
    return {
        "scouting": {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}},
        # zenohd enables the admin space regardless of the file; the permissions stay as in the file
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
            # Segments outlive a killed process, and their large messages would bypass max_message_size.
            "shared_memory": {"enabled": False},
        },
    }

"""Content of a router's zenoh configuration file (JSON5), for zenohd and for `truerate router`. No I/O."""

import json
import re
from collections.abc import Sequence

from bridge.bus import zenoh_settings
from bridge.bus.access_rules import access_control
from bridge.pki.certificate_files import Identity
from bridge.pki.member import Member
from bridge.wire import keys

_INNERMOST, _WIDTH = re.compile(r"[\[{][^\[\]{}]*[\]}]"), 100
# Comment above each part of the file: why the part is there.
_WHY = {
    "connect": "other routers that this router connects to",
    "scouting": "no discovery: this router neither searches for others nor announces itself",
    "adminspace": "the router's settings can be neither read nor changed over the network",
    "transport": "lost peers are noticed early; peers that read nothing for 100 ms, and idle connections, are disconnected",
    "timestamping": "no zenoh timestamps: with them, subscribers drop messages that another publisher's later message overtook",
    "qos": "data for viewers: a slow viewer loses its own messages and delays no other program",
    "low_pass_filter": "no message larger than the wire allows",
    "access_control": "access rules by the common name of the certificate; everything else is denied silently",
}


def rendered(settings: zenoh_settings.Settings, title: str) -> str:
    """Format zenoh settings as the JSON5 text of a router's configuration file, with a comment above each part.

    title: text of the comment at the top of the file, one or more lines.
    """
    parts = []
    for part, value in settings.items():
        why = f"  // {_WHY[part]}\n" if part in _WHY else ""
        shown = _INNERMOST.sub(_on_one_line, json.dumps(value, indent=2)).replace("\n", "\n  ")
        parts.append(f"{why}  {json.dumps(part)}: {shown}")
    head = "".join(f"// {line}\n" for line in title.splitlines())
    return f"{head}{{\n" + ",\n".join(parts) + "\n}\n"


def plain(listen: Sequence[str], join: Sequence[str] = ()) -> zenoh_settings.Settings:
    """Return zenoh settings for a router without certificates, for use on one machine.

    listen: endpoints to listen on. join: endpoints of other routers to connect to.
    """
    settings = zenoh_settings.router(listen, keys.VIEWED)
    return zenoh_settings.joined(settings, join) if join else settings


def guarded(
    listen: Sequence[str], identity: Identity, places: Sequence[tuple[str, Member]], join: Sequence[str] = ()
) -> zenoh_settings.Settings:
    """Return zenoh settings for a router that other machines use: mutual TLS, and access rules for each member.

    listen: endpoints to listen on. identity: paths of the router's certificate files. places: pairs (ward, member).
    join: endpoints of other routers to connect to.
    """
    return zenoh_settings.secured_router(listen, keys.VIEWED, identity, access_control(places), join)


def _on_one_line(match: re.Match[str]) -> str:
    """Join a bracketed group on one line if it is short enough."""
    flat = " ".join(match[0].split()).replace("[ ", "[").replace(" ]", "]").replace("{ ", "{").replace(" }", "}")
    return flat if len(flat) < _WIDTH else match[0]

"""Builds a router's zenoh file (JSON5), for zenohd and for `truerate router`. Pure."""

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
    "connect": "other routers, which this one joins",
    "scouting": "nobody is looked for, and nobody is told that we are here",
    "adminspace": "nobody sees or changes this router's settings over the network",
    "transport": "quick to notice who is gone; who takes nothing for 100 ms is cut off; idle connections are dropped",
    "timestamping": "with zenoh's own, a subscriber with history takes messages of two publishers that cross for old",
    "qos": "what people look at: a slow viewer loses its own, and holds up nobody",
    "low_pass_filter": "nothing larger than the largest message of the wire",
    "access_control": "who may do what, by the common name of its certificate; everything else is denied, silently",
}


def rendered(settings: zenoh_settings.Settings, title: str) -> str:
    """Render settings as JSON5, with a comment above each part. title: lines of the head comment."""
    parts = []
    for part, value in settings.items():
        why = f"  // {_WHY[part]}\n" if part in _WHY else ""
        shown = _INNERMOST.sub(_on_one_line, json.dumps(value, indent=2)).replace("\n", "\n  ")
        parts.append(f"{why}  {json.dumps(part)}: {shown}")
    head = "".join(f"// {line}\n" for line in title.splitlines())
    return f"{head}{{\n" + ",\n".join(parts) + "\n}\n"


def plain(listen: Sequence[str], join: Sequence[str] = ()) -> zenoh_settings.Settings:
    """Return the settings of a router without certificates, for one machine. join: endpoints of routers to connect to."""
    settings = zenoh_settings.router(listen, keys.VIEWED)
    return zenoh_settings.joined(settings, join) if join else settings


def guarded(
    listen: Sequence[str], identity: Identity, places: Sequence[tuple[str, Member]], join: Sequence[str] = ()
) -> zenoh_settings.Settings:
    """Return the settings of a router for other machines: mutual TLS, and access rules for each (ward, member)."""
    return zenoh_settings.secured_router(listen, keys.VIEWED, identity, access_control(places), join)


def _on_one_line(match: re.Match[str]) -> str:
    """Join a bracketed group on one line if it is short enough."""
    flat = " ".join(match[0].split()).replace("[ ", "[").replace(" ]", "]").replace("{ ", "{").replace(" }", "}")
    return flat if len(flat) < _WIDTH else match[0]

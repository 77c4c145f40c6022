"""WebSocket /live of every page: the page sends the topics that it watches, and receives their frames."""

import asyncio
import contextlib
import time

import msgspec
from starlette.routing import BaseRoute, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from estimator.web.client_address import neighbourhood
from estimator.web.hub import TOPICS, Hub, Viewer
from estimator.web.site import Desk
from estimator.web.topic_kinds import kind_of

#: a client that names no topics within this time is not one of our pages, s
FIRST_S = 15.0
#: requests of one viewer: this many at once, then one per interval, s; more wait in the network
WISHES, WISH_S = 16, 0.25
_LATER, _WRONG, _SILENT = 1013, 1007, 1008


class Wish(msgspec.Struct, forbid_unknown_fields=True):
    """Request of a page: the topics to watch from now on, in place of the earlier ones."""

    watch: list[str]


class Pace:
    """Rate limit for a viewer's requests: WISHES at once, then one every WISH_S seconds. Pure: time is an argument."""

    def __init__(self) -> None:
        self._until = 0.0

    def wait_s(self, now: float) -> float:
        """Count one request at monotonic time `now`, s; returns the seconds to wait before reading the next."""
        self._until = max(self._until, now) + WISH_S
        return max(0.0, self._until - now - WISHES * WISH_S)


def routes() -> list[BaseRoute]:
    """Return the route of the WebSocket /live."""
    return [WebSocketRoute("/live", live)]


async def live(socket: WebSocket) -> None:
    """Serve one viewer's WebSocket until it disconnects: read the topics it requests, and send their frames."""
    desk, address = Desk.of(socket), neighbourhood(socket.client.host if socket.client else "")
    await socket.accept()
    if words := desk.hub.full(address):
        await socket.close(_LATER, words)
        return
    viewer = desk.hub.add(address)
    sending = asyncio.create_task(_send(socket, viewer))
    try:
        await _obey(socket, desk.hub, viewer)
    except (WebSocketDisconnect, KeyError, RuntimeError):
        pass  # disconnected, possibly noticed by the sender first, or the client sent bytes
    except TimeoutError:
        await _close(socket, _SILENT, "no topics were requested in time")
    except ValueError as error:
        await _close(socket, _WRONG, str(error)[:100])
    finally:
        desk.hub.remove(viewer)
        sending.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await sending


async def _obey(socket: WebSocket, hub: Hub, viewer: Viewer) -> None:
    """Apply the viewer's requests, at a limited rate."""
    async with asyncio.timeout(FIRST_S):
        hub.watch(viewer, _wished(await socket.receive_text()))
    pace = Pace()
    while True:
        hub.watch(viewer, _wished(await socket.receive_text()))
        await asyncio.sleep(pace.wait_s(time.monotonic()))


async def _close(socket: WebSocket, code: int, words: str) -> None:
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):
        await socket.close(code, words)


async def _send(socket: WebSocket, viewer: Viewer) -> None:
    with contextlib.suppress(RuntimeError, WebSocketDisconnect, OSError):
        while (frame := await viewer.next()) is not None:
            if isinstance(frame, str):
                await socket.send_text(frame)
            else:
                await socket.send_bytes(frame)


def _wished(text: str) -> list[str]:
    """Topics of a request; raises ValueError when the request is invalid."""
    try:
        wish = msgspec.json.decode(text[:4096], type=Wish)
    except msgspec.MsgspecError as error:
        raise ValueError(f"not understood: {error}") from None
    unknown = [topic for topic in wish.watch if kind_of(topic) is None]
    if unknown or len(wish.watch) > TOPICS:
        raise ValueError(f"unknown topic {unknown[0][:40]!r}" if unknown else f"at most {TOPICS} topics")
    return wish.watch

"""The one websocket of every page: it says what it watches, and gets frames."""

import asyncio
import contextlib

import msgspec
from starlette.routing import BaseRoute, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from estimator.web import hub, topics
from estimator.web.desk import Desk
from estimator.web.hub import Viewer

#: viewers at a time, and of one address; a further one is asked to come later
VIEWERS, OF_ONE = 500, 100
_LATER, _WRONG = 1013, 1007
#: seconds between two wishes of a viewer: each makes whole frames, and others wait meanwhile
WISHES_S = 0.25


class Wish(msgspec.Struct, forbid_unknown_fields=True):
    """From now on exactly these."""

    watch: list[str]


def routes() -> list[BaseRoute]:
    """Its place."""
    return [WebSocketRoute("/live", live)]


async def live(socket: WebSocket) -> None:
    """Serve one viewer until it is gone."""
    desk = Desk.of(socket)
    address = socket.client.host if socket.client else ""
    await socket.accept()  # a browser is told the reason of what was begun alone
    if len(desk.hub.viewers) >= VIEWERS or desk.hub.of(address) >= OF_ONE:
        await socket.close(_LATER, "too many viewers")
        return
    viewer = desk.hub.add(address)
    sending = asyncio.create_task(_send(socket, viewer))
    try:
        while True:
            desk.hub.watch(viewer, _wished(await socket.receive_text()))
            await asyncio.sleep(WISHES_S)  # what comes meanwhile is held back
    except (WebSocketDisconnect, KeyError, RuntimeError):
        pass  # it is gone, as whoever sends to it may have seen first, or speaks in bytes
    except ValueError as error:
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):
            await socket.close(_WRONG, str(error)[:100])
    finally:
        desk.hub.remove(viewer)
        sending.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await sending


async def _send(socket: WebSocket, viewer: Viewer) -> None:
    with contextlib.suppress(RuntimeError, WebSocketDisconnect, OSError):
        while (frame := await viewer.next()) is not None:
            if isinstance(frame, str):
                await socket.send_text(frame)
            else:
                await socket.send_bytes(frame)


def _wished(text: str) -> list[str]:
    """The topics of a wish; ValueError when there is no such thing."""
    try:
        wish = msgspec.json.decode(text[:4096], type=Wish)
    except msgspec.MsgspecError as error:
        raise ValueError(f"not understood: {error}") from None
    unknown = [topic for topic in wish.watch if not topics.exists(topic)]
    if unknown or len(wish.watch) > hub.TOPICS:
        raise ValueError(f"no such topic: {unknown[0][:40]!r}" if unknown else f"at most {hub.TOPICS} topics")
    return wish.watch

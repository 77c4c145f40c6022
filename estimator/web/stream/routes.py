"""Routes of the stream of corrected rates, at one path: a WebSocket, and a long poll that waits for new samples."""

import asyncio
import contextlib
from http import HTTPStatus

from starlette.requests import HTTPConnection, Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from estimator.web.api.routes import ROOT, answer, known_parameters
from estimator.web.client_address import neighbourhood
from estimator.web.http_error import Fault
from estimator.web.site import Desk
from estimator.web.stream.documents import Answer, document, message, said
from estimator.web.stream.feeds import Reader
from estimator.web.stream.request import Asked, asked_of

PATH = f"{ROOT}/stream"
#: a WebSocket that is refused is closed with this plus the HTTP status, and the reason in words
REFUSED = 4000
#: most bytes of the reason of a close
_REASON = 123
_PARAMETERS = ("device", "after", "hz")
#: most batches in one answer
MOST = 256


def routes() -> list[BaseRoute]:
    """Return the two routes of the stream, a long poll and a WebSocket, at the same path."""
    return [Route(PATH, poll), WebSocketRoute(PATH, stream)]


async def poll(request: Request) -> Response:
    """Answer a long poll with corrected rates of the requested devices as JSON (`documents.Answer`).

    Waits at most ?wait_s= seconds for samples after the positions ?after=; may answer without samples. docs/stream.md
    describes parameters and answer. Raises Fault for an invalid parameter, too many readers, or no router.
    """
    asked = _asked(request, "wait_s")
    with _reader(request, asked) as reader:
        await reader.begin()
        documents = await reader.read(document, MOST, asked.wait_s)
        after = [said(device, place) for device, place in reader.places.items()]
    return answer(Answer(documents, after or [""]))


async def stream(socket: WebSocket) -> None:
    """Send corrected rates of the requested devices by WebSocket until the program disconnects.

    docs/stream.md describes parameters and messages, which `documents.message` encodes. A refused connection is closed
    with code 4000 + HTTP status, and the reason as text.
    """
    await socket.accept()
    try:
        asked = _asked(socket, "format")
        with _reader(socket, asked) as reader:
            sending = asyncio.create_task(_send(socket, reader, protobuf=asked.protobuf))
            try:
                while (await socket.receive())["type"] != "websocket.disconnect":
                    pass
            finally:
                sending.cancel()
                await asyncio.wait({sending})
    except Fault as fault:
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):
            reason = fault.message.encode()[:_REASON].decode(errors="ignore")
            await socket.close(REFUSED + fault.status, reason)


async def _send(socket: WebSocket, reader: Reader, *, protobuf: bool) -> None:
    """Send what follows; waits while the program is slow, and then skips what is no longer kept."""
    with contextlib.suppress(RuntimeError, WebSocketDisconnect, OSError):
        await reader.begin()
        while True:
            for said in await reader.read(lambda one: message(one, protobuf=protobuf)):
                await (socket.send_text(said) if isinstance(said, str) else socket.send_bytes(said))


def _asked(connection: HTTPConnection, own: str) -> Asked:
    asked = asked_of(known_parameters(connection, *_PARAMETERS, own))
    known = Desk.of(connection).known
    absent = [device for device in asked.devices if device not in known.stories]
    if not known.stories or (absent and not known.looked):
        words = "This device was not heard yet: the dashboard has just started, or no bridge runs. Try again."
        raise Fault(HTTPStatus.SERVICE_UNAVAILABLE, "no_device", words, {"Retry-After": "1"})
    for device in absent:
        Desk.of(connection).story(device)
    return asked


def _reader(connection: HTTPConnection, asked: Asked) -> contextlib.AbstractContextManager[Reader]:
    desk, address = Desk.of(connection), neighbourhood(connection.client.host if connection.client else "")
    return desk.feeds.reader(desk.client, asked, address)

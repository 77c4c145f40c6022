"""Reader for the body of a request, or for a form in it, with limits of size and time."""

import asyncio
from http import HTTPStatus
from urllib.parse import parse_qsl

from starlette.requests import ClientDisconnect, Request

from estimator.web.http_error import Fault

MAX_BYTES = 16_384
#: longest time for receiving a body, s
WHOLE_S = 10.0


async def body(request: Request) -> bytes:
    """Read the whole body of a request. Raises Fault if it is larger than MAX_BYTES, too slow, or incomplete."""
    found = b""
    try:
        async with asyncio.timeout(WHOLE_S):
            async for part in request.stream():
                found += part
                if len(found) > MAX_BYTES:
                    raise Fault(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too_large", most=MAX_BYTES)
    except (TimeoutError, ClientDisconnect):
        raise Fault(HTTPStatus.REQUEST_TIMEOUT, "incomplete", headers={"Connection": "close"}) from None
    return found


async def fields(request: Request) -> dict[str, str]:
    """Read the fields of a form by name; of repeated names the last is used. Raises Fault for a malformed form."""
    text = (await body(request)).decode("utf-8", "replace")
    try:
        return dict(parse_qsl(text, keep_blank_values=True, max_num_fields=20))
    except ValueError:
        raise Fault(HTTPStatus.BAD_REQUEST, "bad_form") from None

"""What a page's form or a program's JSON says, within bounds."""

from http import HTTPStatus
from urllib.parse import parse_qsl

from starlette.requests import Request

from estimator.web.fault import Fault

MAX_BYTES = 16_384


async def body(request: Request) -> bytes:
    """All of it; Fault when it is more than any of ours."""
    found = b""
    async for part in request.stream():
        found += part
        if len(found) > MAX_BYTES:
            raise Fault(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too_large", f"More than {MAX_BYTES} bytes are not taken.")
    return found


async def fields(request: Request) -> dict[str, str]:
    """The fields of a form; the last of those that have one name."""
    text = (await body(request)).decode("utf-8", "replace")
    try:
        return dict(parse_qsl(text, keep_blank_values=True, max_num_fields=20))
    except ValueError:
        raise Fault(HTTPStatus.BAD_REQUEST, "bad_form", "The form was not understood.") from None

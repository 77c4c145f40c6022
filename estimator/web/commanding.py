"""Routes of the commands to a device: one POST route for each verb, for pages and for the API."""

from collections.abc import Awaitable, Callable

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from estimator.web.site import VERBS

#: handles a request for a verb
Obey = Callable[[Request, str], Awaitable[Response]]


def commands(under: str, obey: Obey) -> list[BaseRoute]:
    """Return one POST route `under`/VERB for each verb; `obey(request, verb)` handles its requests."""

    def of(verb: str) -> Callable[[Request], Awaitable[Response]]:
        async def command(request: Request) -> Response:
            return await obey(request, verb)

        return command

    return [Route(f"{under}/{verb}", of(verb), methods=["POST"]) for verb in VERBS]

"""Which language a page is written in: as a link says, which a cookie then keeps, or as the browser asks."""

from starlette.requests import Request
from starlette.responses import Response

from estimator.language.texts import LANGUAGES, chosen

COOKIE = "truerate-language"
_YEAR_S = 365 * 86400


def language(request: Request) -> str:
    """One of LANGUAGES."""
    asked = (request.query_params.get("lang", ""), request.cookies.get(COOKIE, ""))
    return chosen(asked, request.headers.get("accept-language", ""))


def keep(request: Request, response: Response) -> Response:
    """Remember a language that was asked for by a link."""
    asked = request.query_params.get("lang", "")
    if asked in LANGUAGES:
        secure = request.url.scheme == "https"
        response.set_cookie(COOKIE, asked, max_age=_YEAR_S, httponly=True, samesite="lax", secure=secure)
    response.headers["Vary"] = "Accept-Language, Cookie"
    return response

"""Language of a page: chosen by a link and kept in a cookie, else by the browser's preference."""

from starlette.requests import Request
from starlette.responses import Response

from estimator.language.texts import LANGUAGES, chosen

COOKIE = "truerate-language"
_YEAR_S = 365 * 86400


def language(request: Request) -> str:
    """Choose the language of a request, one of LANGUAGES: by ?lang= in the link, else cookie, else the browser."""
    asked = (request.query_params.get("lang", ""), request.cookies.get(COOKIE, ""))
    return chosen(asked, request.headers.get("accept-language", ""))


def keep(request: Request, response: Response) -> Response:
    """Store the language of ?lang= in a cookie of the response, for a year; returns the response."""
    asked = request.query_params.get("lang", "")
    if asked in LANGUAGES:
        secure = request.url.scheme == "https"
        response.set_cookie(COOKIE, asked, max_age=_YEAR_S, httponly=True, samesite="lax", secure=secure)
    response.headers["Vary"] = "Accept-Language, Cookie"
    return response

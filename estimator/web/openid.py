"""Login by an OpenID Connect provider: code flow with PKCE, by Authlib. Only this file uses Authlib."""

import logging
import secrets
import ssl
from collections.abc import Mapping
from http import HTTPStatus
from pathlib import Path
from typing import Any

from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Mount, Route

from bridge.config.schema import ConfigError, check
from bridge.runtime import os_errors
from estimator.config.dashboard import PERSON_ROLES, Dashboard, OpenId, PersonRole
from estimator.web.http_error import Fault
from estimator.web.pages import begin, own, show

log = logging.getLogger(__name__)

#: longest time between leaving for the provider and coming back, s
_AWAY_S = 600


def routes(settings: Dashboard) -> list[BaseRoute]:
    """Return the routes to the OpenID Connect provider and back; none if the ward file names no provider.

    Raises ConfigError if Authlib is not installed or the secret's file cannot be read.
    """
    if (there := settings.openid) is None:
        return []
    provider = _provider(there)
    from authlib.integrations.base_client import OAuthError  # noqa: PLC0415 - an extra
    from httpx2 import HTTPError  # noqa: PLC0415 - as above
    from joserfc.errors import JoseError  # noqa: PLC0415 - as above
    from starlette.middleware.sessions import SessionMiddleware  # noqa: PLC0415 - needs itsdangerous, of the same extra

    failures = (OAuthError, HTTPError, JoseError, ValueError, KeyError)

    async def login(request: Request) -> Response:
        request.session["to"] = own(request.query_params.get("to", "/"))
        try:
            answer: Response = await provider.authorize_redirect(request, str(request.url_for("openid_back")))
        except failures as error:
            raise _failed(error) from error
        return answer

    async def back(request: Request) -> Response:
        try:
            issuer = {"iss": {"essential": True, "value": there.issuer}}
            token = await provider.authorize_access_token(request, claims_options=issuer)
            claims = token["userinfo"]
            name = check(str(claims[there.name_claim]).lower(), there.name_claim)
        except failures as error:
            raise _failed(error) from error
        if (role := _role(there, claims)) is None:
            log.warning(
                "%s logged in at the provider, but no role is configured for the person's %s", name, there.claim
            )
            raise Fault(HTTPStatus.FORBIDDEN, "openid_refused")
        # A page, not a redirect: the browser sends a strict cookie only with a request that begins at this site.
        page = show(request, "onward.html", {"to": request.session.pop("to", "/"), "name": name})
        begin(request, page, name, role, elsewhere=True)
        return page

    kept = Middleware(
        SessionMiddleware,
        secret_key=secrets.token_urlsafe(32),
        session_cookie="truerate-openid",
        max_age=_AWAY_S,
        path="/openid",
        same_site="lax",
        https_only=bool(settings.certificate) or settings.behind_proxy,
    )
    ways = [Route("/login", login), Route("/back", back, name="openid_back")]
    return [Mount("/openid", routes=ways, middleware=[kept])]


def _provider(there: OpenId) -> Any:
    """Client of the provider, whose addresses are read at the first login. Raises ConfigError."""
    try:
        from authlib.integrations.starlette_client import OAuth  # noqa: PLC0415 - an extra
    except ImportError:
        raise ConfigError("[dashboard.openid] needs Authlib: pip install 'truerate[openid]'") from None
    try:
        secret = Path(there.secret_file).read_text("utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        why = os_errors.why(error) if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigError(f"[dashboard.openid]: secret_file {there.secret_file!r}: {why}") from None
    return OAuth().register(
        "openid",
        server_metadata_url=f"{there.issuer.rstrip('/')}/.well-known/openid-configuration",
        client_id=there.client_id,
        client_secret=secret,
        client_kwargs={
            "scope": "openid profile",
            "code_challenge_method": "S256",
            "timeout": 10.0,
            "verify": ssl.create_default_context(),  # trusts the machine's authorities, the hospital's own among them
        },
    )


def _role(there: OpenId, claims: Mapping[str, Any]) -> PersonRole | None:
    """The highest role that a person's groups give."""
    found = claims.get(there.claim, ())
    groups = [found] if isinstance(found, str) else found if isinstance(found, list) else []
    roles = {there.roles[group] for group in groups if isinstance(group, str) and group in there.roles}
    return max(roles, key=PERSON_ROLES.index, default=None)


def _failed(error: Exception) -> Fault:
    log.warning("the login by OpenID Connect failed: %s: %s", type(error).__name__, error)
    return Fault(HTTPStatus.BAD_GATEWAY, "openid_failed")

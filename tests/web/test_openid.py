"""Login by an OpenID Connect provider that runs on this machine: what lets in, with which role, and what does not."""

import re
import warnings
from collections.abc import Iterator
from pathlib import Path

import httpx2 as httpx
import pytest
from playwright.sync_api import Browser, expect

from bridge.toml.loader import ConfigError
from estimator.config.dashboard import Dashboard, OpenId
from estimator.demo.ward import free_port
from estimator.web.serve import Server
from tests.web.asking import PEOPLE
from tests.web.conftest import Site, served
from tests.web.talk import WARD

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # the provider uses an older part of Authlib
    from oidc_provider_mock import User, run_server_in_thread

pytestmark = [
    pytest.mark.filterwarnings("ignore::authlib.deprecate.AuthlibDeprecationWarning"),
    pytest.mark.filterwarnings("ignore:get_jwt_config:DeprecationWarning"),
]
USERS = (
    User(sub="1", claims={"preferred_username": "Joy", "groups": ["nurses", "night"]}),
    User(sub="2", claims={"preferred_username": "root", "groups": ["nurses", "it"]}),
    User(sub="3", claims={"preferred_username": "visitor", "groups": "visitors"}),
    User(sub="4", claims={"preferred_username": "J. R.", "groups": ["nurses"]}),
)


@pytest.fixture(scope="module")
def issuer() -> Iterator[str]:
    with run_server_in_thread(user_claims=USERS, require_nonce=True) as provider:
        yield f"http://localhost:{provider.server_port}"


def settings(issuer: str, folder: Path) -> OpenId:
    secret = folder / "secret"
    secret.write_text("a secret\n")
    roles = {"nurses": "operator", "it": "administrator"}
    return OpenId(issuer=issuer, client_id="truerate", secret_file=str(secret), roles=roles)  # type: ignore[arg-type]


@pytest.fixture
def site(issuer: str, tmp_path: Path) -> Iterator[Site]:
    made = served(openid=settings(issuer, tmp_path))
    yield made
    made.stop()


def back(browser: httpx.Client, site: Site, sub: str) -> str:
    """The address to which the provider sends a person who logged in there."""
    there = browser.get(f"{site.url}/openid/login?to=/report")
    assert there.status_code == 302
    assert "code_challenge_method=S256" in there.headers["location"]
    return str(browser.post(there.headers["location"], data={"sub": sub}).headers["location"])


@pytest.mark.parametrize(("sub", "name", "administrator"), [("1", "joy", False), ("2", "root", True)])
def test_a_group_gives_a_role(site: Site, sub: str, name: str, administrator: bool) -> None:
    with httpx.Client(timeout=60) as browser:
        came = browser.get(back(browser, site, sub))
        assert came.status_code == 200
        assert 'content="0; url=/report"' in came.text
        page = browser.get(f"{site.url}/").text
        assert f"<span>{name}</span>" in page
        assert ('href="/people"' in page) is administrator
        assert browser.get(f"{site.url}/people").status_code == (200 if administrator else 403)


def test_a_change_of_people_here_does_not_end_it(site: Site) -> None:
    with httpx.Client(timeout=60) as browser:
        browser.get(back(browser, site, "1"))
        site.server.desk.use(Dashboard(openid=site.server.desk.settings.openid), site.server.desk.treatment)
        assert "<span>joy</span>" in browser.get(f"{site.url}/").text


def test_who_has_no_role_or_no_usable_name_is_not_let_in(site: Site) -> None:
    for sub, code in (("3", 403), ("4", 502)):
        with httpx.Client(timeout=60) as browser:
            assert browser.get(back(browser, site, sub)).status_code == code
            assert 'name="csrf"' not in browser.get(f"{site.url}/").text


def test_what_another_browser_began_is_not_finished(site: Site) -> None:
    with httpx.Client(timeout=60) as one, httpx.Client(timeout=60) as another:
        address = back(one, site, "1")
        assert another.get(address).status_code == 502
        assert one.get(address).status_code == 200
        assert one.get(address).status_code == 502, "a code is good once"
        assert one.get(re.sub("state=[^&]+", "state=guessed", address)).status_code == 502


def test_a_token_of_another_issuer_is_refused(issuer: str, tmp_path: Path) -> None:
    site = served(openid=settings(f"{issuer}/", tmp_path))
    with httpx.Client(timeout=60) as browser:
        assert browser.get(back(browser, site, "1")).status_code == 502
    site.stop()


def test_a_provider_that_does_not_answer_leaves_passwords(tmp_path: Path) -> None:
    site = served(openid=settings(f"http://localhost:{free_port()}", tmp_path))
    assert httpx.get(f"{site.url}/openid/login", timeout=60).status_code == 502
    assert 'name="password"' in httpx.get(f"{site.url}/login", timeout=60).text
    site.stop()


def test_a_missing_secret_is_said_at_the_start(tmp_path: Path) -> None:
    absent = OpenId(
        issuer="https://a.example", client_id="t", secret_file=str(tmp_path / "no"), roles={"a": "operator"}
    )
    with pytest.raises(ConfigError, match=r"secret_file '.*/no': there is no such file"):
        Server(WARD, Dashboard(people=PEOPLE, openid=absent))


def test_a_browser_comes_back_logged_in(site: Site, browser: Browser) -> None:
    page = browser.new_page(base_url=site.url)
    page.goto("/login?to=/report")
    page.get_by_role("link", name="hospital's account").click()
    page.get_by_role("button", name="1").click()
    page.wait_for_url("**/report")
    expect(page.locator(".person span")).to_have_text("joy")
    page.close()

"""Login sessions, in memory only: a restart logs everybody out. Pure: time is an argument."""

import secrets
from collections import OrderedDict
from collections.abc import Callable, Container
from dataclasses import dataclass, field
from hashlib import sha256

from estimator.language.texts import Texts

#: most sessions at a time; beyond that the oldest ends
SESSIONS = 500


@dataclass(slots=True)
class Session:
    """Login session of one person in one browser.

    until: monotonic time at which the session ends at the latest, s. idle_until: monotonic time at which it ends if no
    request comes, s.
    csrf: token in each of the person's forms.
    role: which actions are allowed. elsewhere: whether an OpenID Connect provider authenticated the person.
    said: message to show once: whether it reports success, the device's id, and a function that gives the text in a
    language.
    """

    name: str
    until: float
    idle_until: float
    role: str = "operator"
    elsewhere: bool = False
    csrf: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    said: tuple[bool, str, Callable[[Texts], str]] | None = None

    #: text of a note that was refused, so that nobody has to write it again
    draft: str = ""

    def take_draft(self) -> str:
        """Return the text of a note that was refused, to show it in the form again, and clear it."""
        draft, self.draft = self.draft, ""
        return draft

    def take_said(self) -> tuple[bool, str, Callable[[Texts], str]] | None:
        """Return the message to show once, or None, and clear it.

        The message is: whether it reports success (True), the device's id, and a function that gives the text in a
        language.
        """
        said, self.said = self.said, None
        return said


class Sessions:
    """Login sessions by cookie; only hashes of the cookies are kept.

    length_s: longest session, s. idle_s: longest time without a request, s.
    """

    def __init__(self, length_s: float, idle_s: float) -> None:
        self._length_s, self._idle_s = length_s, idle_s
        self._sessions: OrderedDict[bytes, Session] = OrderedDict()

    def use(self, length_s: float, idle_s: float, people: Container[str]) -> None:
        """Apply changed limits, and end the sessions of people who are not among `people`.

        length_s: longest session, s. idle_s: longest time without a request, s. Sessions opened by an OpenID Connect
        provider continue.
        """
        self._length_s, self._idle_s = length_s, idle_s
        for hashed, session in [*self._sessions.items()]:
            if session.name not in people and not session.elsewhere:
                del self._sessions[hashed]

    def begin(
        self, name: str, now: float, role: str = "operator", *, elsewhere: bool = False, instead: str | None = None
    ) -> str:
        """Start a person's session at monotonic time `now`, s, and return its cookie.

        role: which actions are allowed. instead: cookie of the browser's earlier session, which ends. elsewhere:
        whether an OpenID Connect provider authenticated the person.
        """
        self.end(instead or "")
        cookie = secrets.token_urlsafe(32)
        self._sessions[_hashed(cookie)] = Session(name, now + self._length_s, now + self._idle_s, role, elsewhere)
        while len(self._sessions) > SESSIONS:
            self._sessions.popitem(last=False)
        return cookie

    def find(self, cookie: str | None, now: float) -> Session | None:
        """Return the session of a cookie and mark it as active; None if unknown or expired. now: monotonic time, s."""
        if not cookie:
            return None
        session = self._sessions.get(_hashed(cookie))
        if session is None:
            return None
        if now >= min(session.until, session.idle_until):
            self.end(cookie)
            return None
        session.idle_until = now + self._idle_s
        return session

    def end(self, cookie: str) -> None:
        """End the session of a cookie; an unknown cookie changes nothing."""
        self._sessions.pop(_hashed(cookie), None)


def _hashed(cookie: str) -> bytes:
    return sha256(cookie.encode("utf-8", "replace")).digest()

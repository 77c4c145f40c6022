"""Who is logged in: kept in memory, so that a restart logs everybody out. Pure: time is an argument."""

import secrets
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from hashlib import sha256

from estimator.language.texts import Texts

#: so many at a time; of more the oldest ends
SESSIONS = 500


@dataclass(slots=True)
class Session:
    """One person in one browser. `csrf` is in every form of theirs.

    said waits to be shown once: whether it is good, of which device, and the answer by language.
    """

    name: str
    until: float
    idle_until: float
    csrf: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    said: tuple[bool, str, Callable[[Texts], str]] | None = None

    #: the text of a note that was not taken: nobody has to write it again
    draft: str = ""

    def take_draft(self) -> str:
        """What is to be written again, once."""
        draft, self.draft = self.draft, ""
        return draft

    def take_said(self) -> tuple[bool, str, Callable[[Texts], str]] | None:
        """What is to be shown, once."""
        said, self.said = self.said, None
        return said


class Sessions:
    """By cookie; the cookies themselves are not kept, only their hashes."""

    def __init__(self, length_s: float, idle_s: float) -> None:
        self._length_s, self._idle_s = length_s, idle_s
        self._sessions: OrderedDict[bytes, Session] = OrderedDict()

    def begin(self, name: str, now: float, instead: str | None = None) -> str:
        """The cookie of a new one, which ends the one that browser had."""
        self.end(instead or "")
        cookie = secrets.token_urlsafe(32)
        self._sessions[_hashed(cookie)] = Session(name, now + self._length_s, now + self._idle_s)
        while len(self._sessions) > SESSIONS:
            self._sessions.popitem(last=False)
        return cookie

    def find(self, cookie: str | None, now: float) -> Session | None:
        """Whose cookie it is, who is not idle then; None when nobody's, or no more."""
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
        """The cookie is worth nothing any more."""
        self._sessions.pop(_hashed(cookie), None)


def _hashed(cookie: str) -> bytes:
    return sha256(cookie.encode("utf-8", "replace")).digest()

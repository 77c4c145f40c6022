"""What is refused, as one thing for pages and programs: a status code of HTTP, a short name, and a text for a person."""

from http import HTTPStatus

from bridge.reasons.codes import Sentences
from estimator.language.texts import LANGUAGES, Texts, texts


class Fault(Exception):
    """Answered as it is: `code` for programs, `message` for people.

    Where no message is given, the pages' texts have one under [fault] and the code, with the values filled in.
    reason: what the estimator answered, where it refused.
    """

    def __init__(
        self,
        status: HTTPStatus,
        code: str,
        message: str = "",
        headers: dict[str, str] | None = None,
        *,
        reason: Sentences = (),
        **values: object,
    ) -> None:
        self._message, self._values = message, values
        self.status, self.code, self.reason, self.headers = status, code, reason, headers or {}
        super().__init__(self.message)

    @property
    def message(self) -> str:
        """The text in English."""
        return self.text(texts(LANGUAGES[0]))

    def text(self, t: Texts) -> str:
        """The text in a language; a message for programs is English in all of them."""
        if self.reason:
            return t.text(self.reason)
        return self._message or t(f"fault.{self.code}", **self._values)

"""HTTP errors for pages and programs: status, short code, and a text for people."""

from http import HTTPStatus

from bridge.reasons.codes import Sentences
from estimator.language.texts import LANGUAGES, Texts, texts


class Fault(Exception):
    """HTTP error sent to the client: `status`, `code` for programs, and a text for people.

    The text is the estimator's reply `reason`, if there is one; else `message`. Without both it is the entry `code` in
    section [fault] of the pages' texts, filled with `values`.
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
        """Text of the error in English."""
        return self.text(texts(LANGUAGES[0]))

    def text(self, t: Texts) -> str:
        """Return the text of the error in the language of `t`; a `message` given on creation is always English."""
        if self.reason:
            return t.text(self.reason)
        return self._message or t(f"fault.{self.code}", **self._values)

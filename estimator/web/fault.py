"""What is refused, as one thing for pages and programs: a status code of HTTP, a short name, and words for a person."""

from http import HTTPStatus


class Fault(Exception):
    """Answered as it is: `code` for programs, `message` for people."""

    def __init__(self, status: HTTPStatus, code: str, message: str, headers: dict[str, str] | None = None) -> None:
        super().__init__(message)
        self.status, self.code, self.message, self.headers = status, code, message, headers or {}

"""Guarded calls of handlers: an exception is logged and counted, and the bus keeps running."""

import logging
from collections.abc import Callable
from typing import Generic, ParamSpec, TypeVar

_P = ParamSpec("_P")
_R = TypeVar("_R")
_log = logging.getLogger(__name__)


class HandlerError(Exception):
    """A handler given to the bus raised an exception; the message names it and may be sent to the asker."""


class Guarded(Generic[_P, _R]):
    """Wraps a handler so that its exceptions are logged and counted, and raised as HandlerError.

    The first failure is logged as an error, repeats at debug level, and the recovery once. where: name of the handler
    in the log. failures: number of failures so far.
    """

    def __init__(self, handler: Callable[_P, _R], where: str) -> None:
        self._handler = handler
        self._where = where
        self._in_a_row = 0
        self.failures = 0

    def __call__(self, *args: _P.args, **kwargs: _P.kwargs) -> _R:
        """Call the handler. Raises HandlerError, already logged, for any exception of the handler."""
        try:
            result = self._handler(*args, **kwargs)
        except Exception as error:
            self.failures += 1
            self._in_a_row += 1
            quiet = self._in_a_row > 1
            _log.log(
                logging.DEBUG if quiet else logging.ERROR,
                "the handler of %s failed (%d times so far)",
                self._where,
                self.failures,
                exc_info=True,
            )
            raise HandlerError(f"{type(error).__name__}: {error}"[:500]) from error
        if self._in_a_row:
            _log.info("the handler of %s works again after %d failures", self._where, self._in_a_row)
            self._in_a_row = 0
        return result

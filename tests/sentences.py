"""Sentences for tests: what was said by its codes, and free text where any sentence will do."""

from collections.abc import Iterable

from bridge.reasons.codes import Code, Sentence, Sentences


def codes(sentences: Iterable[Sentence]) -> list[str]:
    """The codes, in order."""
    return [one.code for one in sentences]


def free(text: str) -> Sentences:
    """A sentence whose text is this one in every language."""
    return (Code.PROFILE_NOTICE(words=text),)

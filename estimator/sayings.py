"""What estimator and bridge say in English, in another language: sentences found again by what is the same in each. Pure."""

import re
from collections.abc import Iterator, Mapping
from functools import lru_cache

_FIELD = re.compile(r"\{(\w+)\}")
#: what stands between two sentences; statements, which have nothing to do with each other, are parted by a semicolon
_MARK, _APART = re.compile(r"[:.,] "), "; "
#: words that are no name, number or unit: two that follow each other
_SENTENCE = re.compile(r"[A-Za-z]{2,} [a-z]{2,}")
#: texts whose translation is remembered: most are said again every second
_REMEMBERED = 4096
#: sentences that are looked for in one statement, of which no speaker's needs half; strangers may write what would take for ever
_TRIES = 100


class _Endless(Exception):
    """As many sentences as may be were looked for in it."""


class Sayings:
    """Sentences by how they read in English, with {fields}; `unknown` is how one that is none of them is shown."""

    def __init__(self, sentences: Mapping[str, str], between: Mapping[str, str], unknown: str) -> None:
        known = sorted(sentences, key=lambda sentence: -len(_FIELD.sub("", sentence)))
        self._plain = {sentence: sentences[sentence] for sentence in known if not _FIELD.search(sentence)}
        self._forms = [_Form(one, sentences[one]) for one in known if one not in self._plain]
        self._between, self._unknown = between, unknown
        self._said = lru_cache(_REMEMBERED)(self._statement)

    def __call__(self, text: str) -> str:
        """The text as it is said; names, numbers, and what nobody has translated, as they are."""
        return self._between.get(_APART, _APART).join(map(self._said, text.split(_APART)))

    def knows(self, text: str) -> bool:
        """Whether nothing of it is left untranslated."""
        return self._unknown.format(words="") not in self(text) if text else True

    def _statement(self, text: str) -> str:
        try:
            return self._any(text, iter(range(_TRIES)))
        except _Endless:
            return self._strange(text)

    def _any(self, text: str, tries: Iterator[int]) -> str:
        whole = self._whole(text, tries)
        if whole is not None:
            return whole
        marks = [(match.start(), match[0]) for match in _MARK.finditer(text)]
        for at, mark in reversed(marks):
            if (left := self._whole(text[:at], tries)) is not None:
                return left + self._between[mark] + self._any(text[at + len(mark) :], tries)
        for at, mark in marks:
            if mark != ", ":
                return self._strange(text[:at]) + self._between[mark] + self._any(text[at + len(mark) :], tries)
        return self._strange(text)

    def _whole(self, text: str, tries: Iterator[int]) -> str | None:
        """One sentence, from its beginning to its end; a full stop may follow."""
        if next(tries, None) is None:
            raise _Endless
        bare = text.removesuffix(".")
        for one in dict.fromkeys((text, bare, bare[:1].lower() + bare[1:])):
            if one in self._plain:
                return self._plain[one]
        for form in self._forms:
            if bare.endswith(form.tail) and bare.startswith(form.heads) and (match := form.match(bare)) is not None:
                return form.said.format(
                    **{name: self._field(value, tries) for name, value in match.groupdict().items()}
                )
        return None

    def _field(self, value: str, tries: Iterator[int]) -> str:
        """What is filled in: a sentence, several after commas, or a name, which stays as it is."""
        parts = [self._whole(part, tries) for part in value.split(", ")]
        if None not in parts:
            return self._between.get(", ", ", ").join(filter(None, parts))
        return self._any(value, tries) if _SENTENCE.search(value) and not value.startswith("`") else value

    def _strange(self, text: str) -> str:
        return self._unknown.format(words=text) if _SENTENCE.search(text) else text


class _Form:
    """A sentence with fields, from one of its heads to its tail; the first letter is a capital where it stands by itself."""

    __slots__ = ("_pattern", "heads", "said", "tail")

    def __init__(self, sentence: str, said: str) -> None:
        head, *between, last, self.tail = _FIELD.split(sentence)
        self.heads, self.said = (head, head[:1].upper() + head[1:], head[:1].lower() + head[1:]), said
        # Each field is as little as will do, for good: a text is gone through once, however many of them there are.
        found = (
            f"(?>(?P<{name}>.+?){re.escape(then)})" for name, then in zip(between[::2], between[1::2], strict=True)
        )
        self._pattern = re.compile(f"{''.join(found)}(?P<{last}>.+)", re.DOTALL)

    def match(self, text: str) -> re.Match[str] | None:
        """What is filled in, of a text with this head and tail."""
        return self._pattern.fullmatch(text, len(self.heads[0]), len(text) - len(self.tail))

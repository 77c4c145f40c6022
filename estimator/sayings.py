"""What estimator and bridge say in English, in another language: sentences found again by what is the same in each. Pure."""

import re
from collections.abc import Mapping
from functools import lru_cache

_FIELD = re.compile(r"\{(\w+)\}")
#: what stands between two sentences, longest way first
_BETWEEN = ("; ", ": ", ". ", ", ")
#: words that are no name, number or unit: two that follow each other
_SENTENCE = re.compile(r"[A-Za-z]{2,} [a-z]{2,}")
#: texts whose translation is remembered: most are said again every second
_REMEMBERED = 4096


class Sayings:
    """Sentences by how they read in English, with {fields}; `unknown` is how one that is none of them is shown."""

    def __init__(self, sentences: Mapping[str, str], between: Mapping[str, str], unknown: str) -> None:
        known = sorted(sentences, key=lambda sentence: -len(_FIELD.sub("", sentence)))
        self._plain = {sentence: sentences[sentence] for sentence in known if not _FIELD.search(sentence)}
        self._patterns = [(_pattern(one), sentences[one]) for one in known if one not in self._plain]
        self._between, self._unknown = between, unknown
        self._said = lru_cache(_REMEMBERED)(self._any)

    def __call__(self, text: str) -> str:
        """The text as it is said; names, numbers, and what nobody has translated, as they are."""
        return self._said(text)

    def knows(self, text: str) -> bool:
        """Whether nothing of it is left untranslated."""
        return self._unknown.format(words="") not in self._said(text) if text else True

    def _any(self, text: str) -> str:
        whole = self._whole(text)
        if whole is not None:
            return whole
        for at, mark in _marks(text):
            if (left := self._whole(text[:at])) is not None:
                return left + self._between[mark] + self._any(text[at + len(mark) :])
        for at, mark in reversed(_marks(text)):
            if mark != ", ":
                return self._strange(text[:at]) + self._between[mark] + self._any(text[at + len(mark) :])
        return self._strange(text)

    def _whole(self, text: str) -> str | None:
        """One sentence, from its beginning to its end; a full stop may follow."""
        bare = text.removesuffix(".")
        for one in dict.fromkeys((text, bare, bare[:1].lower() + bare[1:])):
            if one in self._plain:
                return self._plain[one]
        for pattern, said in self._patterns:
            if (match := pattern.fullmatch(bare)) is not None:
                return said.format(**{name: self._field(value) for name, value in match.groupdict().items()})
        return None

    def _field(self, value: str) -> str:
        """What is filled in: a sentence, several after commas, or a name, which stays as it is."""
        parts = [self._whole(part) for part in value.split(", ")]
        if None not in parts:
            return self._between.get(", ", ", ").join(filter(None, parts))
        return self._any(value) if _SENTENCE.search(value) and not value.startswith("`") else value

    def _strange(self, text: str) -> str:
        return self._unknown.format(words=text) if _SENTENCE.search(text) else text


def _marks(text: str) -> list[tuple[int, str]]:
    """Where sentences may end, from the last on."""
    return sorted(((m.start(), mark) for mark in _BETWEEN for m in re.finditer(re.escape(mark), text)), reverse=True)


def _pattern(sentence: str) -> re.Pattern[str]:
    """Each {field} is as little as will do, and goes not beyond a semicolon."""
    parts = _FIELD.split(sentence)
    found = "".join(f"(?P<{part}>[^;]+?)" if i % 2 else re.escape(part) for i, part in enumerate(parts))
    first = re.escape(sentence[0])
    if sentence[0].isalpha():  # a sentence of its own, or one that goes on
        found = f"(?i:{first})" + found.removeprefix(first)
    return re.compile(found, re.DOTALL)

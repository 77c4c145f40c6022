"""What people read, in each language: one file each under web/texts, with the same keys; and the catalogue."""

import tomllib
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path

from bridge.reasons.catalogue import LANGUAGES, catalogue
from bridge.reasons.codes import Sentence
from estimator.guide.steps import Words

__all__ = ["LANGUAGES", "Texts", "chosen", "texts"]

_FOLDER = Path(__file__).parent.parent / "web" / "texts"


class Texts:
    """One language."""

    def __init__(self, language: str) -> None:
        self.language = language
        with (_FOLDER / f"{language}.toml").open("rb") as file:
            self._texts = tomllib.load(file)
        self._catalogue = catalogue(language)

    @property
    def name(self) -> str:
        """What the language calls itself."""
        return str(self._texts["name"])

    def __call__(self, key: str, **values: object) -> str:
        """The text of a dotted key, as `guide.title`, with its fields filled in; KeyError when there is none."""
        section, _, name = key.partition(".")
        return str(self._texts[section][name]).format(**values)

    def text(self, sentences: Iterable[Sentence]) -> str:
        """What estimator and bridge have said."""
        return self._catalogue.text(sentences)

    def label(self, label: str) -> str:
        """What is counted under a label."""
        return self._catalogue.label(label)

    def say(self, section: str, words: Words) -> str:
        """A sentence of the guide."""
        return self(f"{section}.{words.key}", **words.values)


@cache
def texts(language: str) -> Texts:
    """Of one of LANGUAGES."""
    return Texts(language)


def chosen(asked: Sequence[str], accepted: str = "") -> str:
    """The first that there is of what was asked for, then of an Accept-Language header; else the first of all."""
    weighed = []
    for number, part in enumerate(accepted.split(",")[:20]):
        name, _, weight = part.partition(";q=")
        try:
            weighed.append((-float(weight or 1), number, name.strip().lower()[:2]))
        except ValueError:
            continue
    wished = [*asked, *(name for weight, _, name in sorted(weighed) if weight < 0)]
    return next((name for name in wished if name in LANGUAGES), LANGUAGES[0])

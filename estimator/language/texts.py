"""Loader of the texts that people read: one file per language in web/texts, with the same keys.

Sentences of estimator and bridge come from the catalogue of reasons.
"""

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
    """Texts for people in one language; calling the object with a key returns a text.

    Its methods translate counters' labels, and sentences of the estimator, the bridge and the guide.
    """

    def __init__(self, language: str) -> None:
        self.language = language
        with (_FOLDER / f"{language}.toml").open("rb") as file:
            self._texts = tomllib.load(file)
        self._catalogue = catalogue(language)

    @property
    def name(self) -> str:
        """Name of the language, in that language."""
        return str(self._texts["name"])

    def __call__(self, key: str, **values: object) -> str:
        """Return the text of a dotted key, such as `guide.title`, with its fields filled in.

        Raises KeyError for an unknown key.
        """
        section, _, name = key.partition(".")
        return str(self._texts[section][name]).format(**values)

    def text(self, sentences: Iterable[Sentence]) -> str:
        """Return sentences of the estimator or bridge (code and parameters) as text in this language."""
        return self._catalogue.text(sentences)

    def label(self, label: str) -> str:
        """Return the label of a counter, such as `gaps`, translated to this language."""
        return self._catalogue.label(label)

    def say(self, section: str, words: Words) -> str:
        """Return a sentence of the calibration guide, by its section, key and values.

        Raises KeyError for an unknown section or key.
        """
        return self(f"{section}.{words.key}", **words.values)


@cache
def texts(language: str) -> Texts:
    """Return the texts of a language, one of LANGUAGES; cached."""
    return Texts(language)


def chosen(asked: Sequence[str], accepted: str = "") -> str:
    """Choose the language: first entry of `asked` that is one of LANGUAGES, else by an Accept-Language header.

    accepted: the header's value, or empty. Without a match, the first of LANGUAGES is returned.
    """
    weighed = []
    for number, part in enumerate(accepted.split(",")[:20]):
        name, _, weight = part.partition(";q=")
        try:
            weighed.append((-float(weight or 1), number, name.strip().lower()[:2]))
        except ValueError:
            continue
    wished = [*asked, *(name for weight, _, name in sorted(weighed) if weight < 0)]
    return next((name for name in wished if name in LANGUAGES), LANGUAGES[0])

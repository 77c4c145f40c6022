"""Catalogue of texts: translates reason codes and labels to text, from one TOML file per language in this folder."""

import tomllib
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from bridge.reasons.codes import Sentence, Sentences

#: languages with a file of texts; the first is that of logs and command lines
LANGUAGES = ("en", "zh")
_FOLDER = Path(__file__).parent


class Catalogue:
    """Texts of one language: for reason codes (`sentences`) and for labels of counts (`labels`).

    language: one of LANGUAGES.
    """

    def __init__(self, language: str) -> None:
        with (_FOLDER / f"{language}.toml").open("rb") as file:
            texts = tomllib.load(file)
        self.sentences: dict[str, str] = texts["sentences"]
        self.labels: dict[str, str] = texts["labels"]
        self._join: str = texts["join"]
        self._unknown: str = texts["unknown"]

    def text(self, sentences: Iterable[Sentence]) -> str:
        """Return the text of all sentences, joined in order. An unknown code is shown with its parameters."""
        return self._join.join(map(self._sentence, sentences))

    def label(self, label: str) -> str:
        """Return the words for the label of a count, such as `gaps`, to follow a number.

        The two parts of a label such as `kind: reason` are translated separately.
        """
        return ": ".join(self.labels.get(part, part.replace("_", " ")) for part in label.split(": "))

    def _sentence(self, sentence: Sentence) -> str:
        params = sentence.params
        if "label" in params:
            params = {**params, "label": self.label(params["label"])}
        try:
            return self.sentences[sentence.code].format_map(params)
        except KeyError:  # from a later version: unknown code or parameters
            said = ", ".join(f"{name}: {value}" for name, value in params.items())
            return self._unknown.format(code=sentence.code, params=said)


@cache
def catalogue(language: str) -> Catalogue:
    """Return the texts of a language, one of LANGUAGES. Each language is loaded only once."""
    return Catalogue(language)


def explain(reason: Iterable[Sentence], language: str = LANGUAGES[0]) -> str:
    """Return the text of a reason, which consists of sentences (reason codes with parameters). language: "en" or "zh"."""
    return catalogue(language).text(reason)


def english(*sentences: Sentence) -> str:
    """Return the English text of sentences (reason codes with parameters), for logs and command lines."""
    return catalogue(LANGUAGES[0]).text(sentences)


def in_words(label: str) -> str:
    """Return the English words for the label of a count, such as `gaps`, to follow a number."""
    return catalogue(LANGUAGES[0]).label(label)


def sentences_as_json(sentences: Sentences) -> list[dict[str, Any]]:
    """Return sentences for JSON, as one dict for each.

    Keys: `code`, `params` (a dict of the parameters by name) and `text` (English).
    """
    return [{"code": str(one.code), "params": one.params, "text": english(one)} for one in sentences]

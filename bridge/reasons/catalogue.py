"""Text of codes and labels, from one TOML file a language beside this module."""

import tomllib
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from bridge.reasons.codes import Sentence, Sentences

#: the first is what logs and command lines are written in
LANGUAGES = ("en", "zh")
_FOLDER = Path(__file__).parent


class Catalogue:
    """The texts of one language."""

    def __init__(self, language: str) -> None:
        with (_FOLDER / f"{language}.toml").open("rb") as file:
            texts = tomllib.load(file)
        self.sentences: dict[str, str] = texts["sentences"]
        self.labels: dict[str, str] = texts["labels"]
        self._join: str = texts["join"]
        self._unknown: str = texts["unknown"]

    def text(self, sentences: Iterable[Sentence]) -> str:
        """All of them, one after the other; a code that is not known is shown with its parameters."""
        return self._join.join(map(self._sentence, sentences))

    def label(self, label: str) -> str:
        """What is counted under a label, as a person says it after a number; `kind: reason` is two labels."""
        return ": ".join(self.labels.get(part, part.replace("_", " ")) for part in label.split(": "))

    def _sentence(self, sentence: Sentence) -> str:
        params = sentence.params
        if "label" in params:
            params = {**params, "label": self.label(params["label"])}
        try:
            return self.sentences[sentence.code].format_map(params)
        except KeyError:  # of a later version: another code, or other parameters
            said = ", ".join(f"{name}: {value}" for name, value in params.items())
            return self._unknown.format(code=sentence.code, params=said)


@cache
def catalogue(language: str) -> Catalogue:
    """The catalogue of one of LANGUAGES."""
    return Catalogue(language)


def explain(reason: Iterable[Sentence], language: str = LANGUAGES[0]) -> str:
    """The text of a reason, such as that of a result, a status or a revision; language: "en" or "zh"."""
    return catalogue(language).text(reason)


def english(*sentences: Sentence) -> str:
    """The English text, for logs and command lines."""
    return catalogue(LANGUAGES[0]).text(sentences)


def in_words(label: str) -> str:
    """What is counted under a label, in English."""
    return catalogue(LANGUAGES[0]).label(label)


def sentences_as_json(sentences: Sentences) -> list[dict[str, Any]]:
    """For programs: of each sentence its code, its parameters and the English text."""
    return [{"code": str(one.code), "params": one.params, "text": english(one)} for one in sentences]

"""What people read, in each language: one file each under web/texts, with the same keys."""

import tomllib
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from estimator.guide.reasons import Words
from estimator.sayings import Sayings

#: the first is taken where none of them is asked for
LANGUAGES = ("en", "zh")
#: what stands between two sentences of estimator and bridge, by language
_BETWEEN = {"zh": {"; ": "；", ": ": "：", ". ": "。", ", ": "，"}}
_FOLDER = Path(__file__).parent / "web" / "texts"


class Texts:
    """One language."""

    def __init__(self, language: str) -> None:
        self.language = language
        with (_FOLDER / f"{language}.toml").open("rb") as file:
            self._texts = tomllib.load(file)
        said = self._texts.get("said")
        #: in other languages than their own, what estimator and bridge say
        self.sayings = None if said is None else Sayings(said, _BETWEEN[language], self._texts["frame"]["foreign"])

    @property
    def name(self) -> str:
        """What the language calls itself."""
        return str(self._texts["name"])

    def __call__(self, key: str, **values: object) -> str:
        """The text of a dotted key, as `guide.title`, with its fields filled in; KeyError when there is none."""
        section, _, name = key.partition(".")
        return str(self._texts[section][name]).format(**values)

    def said(self, text: str) -> str:
        """What estimator or bridge has said, in English."""
        return text if self.sayings is None else self.sayings(text)

    def say(self, section: str, words: Words) -> str:
        """A sentence of the guide."""
        values = {name: self.said(value) for name, value in words.values.items()}
        return self(f"{section}.{words.key}", **values)


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

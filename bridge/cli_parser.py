"""A parser of arguments that names the nearest word where one is misspelt."""

import argparse
import re
from typing import NoReturn

from bridge.toml_file import nearest

_NO_CHOICE = re.compile(r"(?P<where>.*)invalid choice: '(?P<word>.*)' \(choose from (?P<known>.*)\)", re.DOTALL)


class Parser(argparse.ArgumentParser):
    """Its verbs are of its kind, too."""

    def error(self, message: str) -> NoReturn:
        """See argparse; the nearest word stands where all would."""
        if match := _NO_CHOICE.fullmatch(message):
            known = re.findall(r"[\w-]+", match["known"])
            message = f"{match['where']}unknown {match['word']!r}; {nearest(match['word'], known)}"
        super().error(message)

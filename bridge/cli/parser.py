"""Argument parser that suggests the nearest known word for a misspelt one, and functions that add verbs to a parser."""

import argparse
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NoReturn, Protocol, TypeVar

from bridge.toml.loader import ConfigError, nearest

P_co = TypeVar("P_co", covariant=True)
Run = Callable[[argparse.Namespace], int]

_OPTION = re.compile(r"--?[a-z][\w-]*")
_NO_CHOICE = re.compile(r"(?P<where>.*)invalid choice: '(?P<word>.*)' \(choose from (?P<known>.*)\)", re.DOTALL)


class Verbs(Protocol[P_co]):
    """Type of the object that argparse's `add_subparsers` returns, to which verbs (subcommands) are added.

    P_co: type of a verb's parser.
    """

    def add_parser(self, name: str, **how: Any) -> P_co:
        """Add a verb and return its parser. name: the verb as typed. how: keyword arguments of argparse's parser."""


class Parser(argparse.ArgumentParser):
    """Argument parser whose error messages suggest the nearest known word; it also lists its subcommands."""

    def add_subparsers(self, **how: Any) -> "argparse._SubParsersAction[Any]":
        """Add subcommands as argparse does, and store them for `commands`. how: argparse's keyword arguments."""
        self._verbs = super().add_subparsers(**how)
        return self._verbs

    @property
    def commands(self) -> "dict[str, Parser]":
        """The parser of each subcommand, by name; {} if the parser has no subcommands."""
        verbs = getattr(self, "_verbs", None)
        return dict(verbs.choices) if verbs else {}

    def parse_known_args(  # type: ignore[override] # argparse's overloads say no more
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse arguments as argparse does; return the namespace and an empty list.

        An unknown argument ends the program with exit code 2 and an error that names the verb's nearest option.
        """
        given, over = super().parse_known_args(args, namespace)
        if over:
            self.error(_left_over(over, _OPTION.findall(self.format_usage())))
        return given, over

    def error(self, message: str) -> NoReturn:
        """Print an error in one line on stderr and exit with code 2.

        For an invalid choice, the message names the nearest valid choice instead of all choices.
        """
        if match := _NO_CHOICE.fullmatch(message):
            known = re.findall(r"[\w-]+", match["known"])
            message = f"{match['where']}unknown {match['word']!r}; {nearest(match['word'], known)}"
        self.exit(2, f"{self.prog}: {message} (`{self.prog} --help` says more)\n")


def _left_over(words: Sequence[str], options: Iterable[str]) -> str:
    wrong = next((word for word in words if word.startswith("-")), "").partition("=")[0]
    if wrong:
        return f"unknown option {wrong!r}; {nearest(wrong, (one for one in options if one.startswith('--')))}"
    return f"unexpected {' '.join(map(repr, words))}"


class Version(argparse.Action):
    """Action of the option `--version`: prints truerate's version and exits.

    The version is looked up only when the option is given, because the lookup is slow.
    """

    def __init__(self, option_strings: Sequence[str], dest: str) -> None:
        super().__init__(option_strings, dest, nargs=0, help="show program's version number and exit")

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        """See argparse."""
        from importlib.metadata import version  # noqa: PLC0415

        print(f"{parser.prog} {version('truerate')}")
        parser.exit()


def seed(text: str) -> int:
    """Convert an option's text to a random seed, a whole number from 0 to 2**31 - 1.

    For argparse's `type`. Raises ArgumentTypeError for any other text.
    """
    if not (text.isdecimal() and int(text) < 1 << 31):
        raise argparse.ArgumentTypeError(f"{text!r}: use a whole number from 0 to {(1 << 31) - 1}")
    return int(text)


def sentence(words: str) -> str:
    """Return a help text as a sentence: with a capital letter and a full stop."""
    return f"{words[:1].upper()}{words[1:]}{'' if words.endswith(('.', '?')) else '.'}"


def add_verb(
    verbs: "Verbs[argparse.ArgumentParser]",
    name: str,
    run: Callable[[argparse.Namespace], int | None],
    does: str,
    more: str = "",
) -> argparse.ArgumentParser:
    """Add a verb that calls `run` with the parsed arguments, and return the verb's parser.

    run: returns an exit code, or None for exit code 0. does: help text without a full stop.
    more: text shown after the options, with its own line breaks.
    """
    verb = _add(verbs, name, does, sentence(does), more)
    verb.set_defaults(run=run)
    return verb


def add_guarded(
    verbs: "Verbs[argparse.ArgumentParser]", name: str, run: Run, does: str, example: str
) -> argparse.ArgumentParser:
    """Add a verb whose `run` may raise ValueError for invalid arguments, and return the verb's parser.

    A ValueError of `run` is raised as ConfigError, which the command reports as an error in the arguments.
    run: takes the parsed arguments and returns an exit code. does: help text without a full stop.
    example: command shown after the options.
    """
    return add_verb(verbs, name, _guarded(run), does, f"Example: {example}")


def add_group(
    verbs: "Verbs[argparse.ArgumentParser]", name: str, does: str, more: str = "", *, about: str = ""
) -> "Verbs[argparse.ArgumentParser]":
    """Add a verb that has subcommands of its own; return the object to which these are added.

    does: help text. about, more: text before and after the list of subcommands; by default `about` is the help text.
    """
    return _add(verbs, name, does, about or sentence(does), more).add_subparsers(metavar="VERB", required=True)


def add_device(verb: argparse.ArgumentParser, more: str = "") -> None:
    """Add the positional argument `device`, the id of a device. more: text appended to its help text."""
    verb.add_argument("device", help=f"device id, as `truerate devices` shows it{more}")


def _add(
    verbs: "Verbs[argparse.ArgumentParser]", name: str, does: str, about: str, more: str
) -> argparse.ArgumentParser:
    how = argparse.RawDescriptionHelpFormatter if "\n" in about + more else argparse.HelpFormatter
    return verbs.add_parser(name, help=does, description=about, epilog=more, formatter_class=how)


def _guarded(run: Run) -> Run:
    """Turn a ValueError of a verb into ConfigError, which the command reports without a traceback."""

    def guarded(args: argparse.Namespace) -> int:
        try:
            return run(args)
        except ValueError as error:
            raise ConfigError(str(error)) from None

    return guarded

"""Texts for people keep to plain English: no riddles, no history, no self-defence, no endless sentences."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.cli.parser import Parser
from estimator.cli.main import build

ROOT = Path(__file__).parent.parent
GENERATED = {"codes.md", "command-line.md", "configuration.md", "metrics.md"}
PAGES = [*sorted((ROOT / "docs").rglob("*.md")), ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md"]
CATALOGUES = [ROOT / "bridge/reasons/en.toml", ROOT / "estimator/web/texts/en.toml"]
MOST_WORDS = 40
#: of a sentence that a nurse may read, by language; Chinese: characters
MOST_FOR_A_NURSE = {"en": 12, "zh": 24}

#: what no text may contain, and what to write instead
RULES = {
    r"\b(honestly|of course|obviously|clearly|simply|just works|needless to say|admittedly)\b": "self-defence: leave it out",
    r"\b(who|what) it is that\b|\bthat it all\b|\ball of it\b|\bsuch a one\b": "a riddle: name the thing",
    r"\b(?:is|are|was|were) none\b(?=[.,;]|$)": "say what is invalid and what is expected",
    r"\b(?:is|are) taken for\b|\bmore than is taken\b": "use `counts as`, or say which values are accepted",
    r"\b(?:made|begun) anew\b": "use `restarted` or `rewritten`",
}
#: more for pages and help; messages may say what a device did before, and what a screen says
OF_PAGES = {
    r"\b(no longer|used to (?:be|have|do)|formerly|in the past|nowadays|any ?more)\b": "history: say what holds now",
    r"\b(?:is|are) said\b|\bsaid once\b": "use an active verb: the log reports, the file states",
}


def pages() -> Iterator[tuple[str, str]]:
    """Name and text of each page, without code, tables' pipes and links' addresses."""
    for path in PAGES:
        if path.name not in GENERATED:
            text = re.sub(r"(?s)```.*?```|<!--.*?-->", "\n\n", path.read_text(encoding="utf-8"))
            if path.name == "wire.md":  # its table of codes repeats the catalogue, which is looked at itself
                text = text.partition("\n## Codes")[0]
            text = re.sub(r"\]\([^)]*\)", "]", re.sub(r"`[^`]*`", "`x`", text))
            yield str(path.relative_to(ROOT)), re.sub(r"(?m)^\s*(?:[-*#>]|\d+\.)\s|\|", "\n\n", text)


def helps(parser: Parser) -> Iterator[tuple[str, str]]:
    """Command and text of each description and each option's help; the layout of an epilog stays apart."""
    yield parser.prog, parser.description or ""
    for block in re.split(r"\n(?=\s*\S+:?\n|\s{2,}\S)|\n\n", parser.epilog or ""):
        yield parser.prog, re.sub(r"(?m)^\s*truerate .*$", "", block)
    for action in parser._actions:
        if isinstance(action.help, str):
            yield f"{parser.prog} {'/'.join(action.option_strings) or action.dest}", action.help
    for inner in parser.commands.values():
        yield from helps(inner)


def catalogues() -> Iterator[tuple[str, str]]:
    for path in CATALOGUES:
        yield from flat(path.name, tomllib.loads(path.read_text(encoding="utf-8")))


def flat(name: str, value: object) -> Iterator[tuple[str, str]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from flat(f"{name} {key}", inner)
    elif isinstance(value, str):
        yield name, value


def faults(where: str, text: str) -> Iterator[str]:
    rules = RULES if ".toml" in where else RULES | OF_PAGES
    for rule, instead in rules.items():
        for match in re.finditer(rule, text, re.IGNORECASE):
            yield f"{where}: {match[0]!r}: {instead}"
    for sentence in re.split(r"(?<=[.!?:;])\s+|\n\s*\n", text):
        if (words := len(re.findall(r"[^\W\d_]{2,}", sentence))) > MOST_WORDS:
            yield f"{where}: a sentence of {words} words: {' '.join(sentence.split())[:80]} …"


@pytest.mark.parametrize("texts", [pages, lambda: helps(build()), catalogues], ids=["pages", "help", "catalogues"])  # type: ignore[arg-type]
def test_texts_are_plain_english(texts: object) -> None:
    assert callable(texts)
    found = [fault for where, text in texts() for fault in faults(where, text)]
    assert not found, "\n".join(found)


def lengths(language: str, text: str) -> Iterator[tuple[int, str]]:
    """Words, or Chinese characters, of each sentence; what is filled in counts as one."""
    one = r"[一-鿿]|\{" if language == "zh" else r"[\w°%'’/{}-]+"
    for sentence in re.split(r"[.!?。！？](?=\s|$|[^\x00-\x7f])", re.sub(r"`[^`]*`|\{\w+\}", "{}", text)):
        yield len(re.findall(one, sentence)), sentence.strip()


@pytest.mark.parametrize("language", MOST_FOR_A_NURSE)
def test_sentences_for_a_nurse_are_short(language: str) -> None:
    """All that pages and devices say: nobody knows which of it a nurse meets first."""
    files = [path.with_name(f"{language}.toml") for path in CATALOGUES]
    texts = [one for path in files for one in flat(path.parent.name, tomllib.loads(path.read_text(encoding="utf-8")))]
    most = MOST_FOR_A_NURSE[language]
    long = [f"{where}: {n}: {said}" for where, text in texts for n, said in lengths(language, text) if n > most]
    assert not long, "\n".join(long)


@pytest.mark.parametrize(
    "text", ["This is no longer needed.", "port 70000 is none", "It is said once.", "word " * 41, "Of course it works."]
)
def test_the_rules_find_what_they_are_for(text: str) -> None:
    assert list(faults("here", text))

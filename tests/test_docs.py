"""docs/ and README.md: what they name is there, and what they tell people to type is taken."""

import argparse
import re
import shlex
from pathlib import Path

import pytest

from estimator.cli.main import build

ROOT = Path(__file__).parent.parent
GENERATED = {"codes.md", "command-line.md", "configuration.md", "metrics.md"}
PAGES = sorted(path for path in [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md"] if path.name not in GENERATED)
NAMES = {path.name for part in ("bridge", "estimator", "tests", "configs") for path in (ROOT / part).rglob("*")}
#: a word that stands for others, or goes on in another place
PLACEHOLDER = re.compile(r"…|\.\.\.|[<*]")

each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


@each_page
def test_what_is_named_is_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", text):
        assert link.startswith("http") or (page.parent / link).exists(), link
    for named in re.findall(r"`([\w./-]+\.(?:py|proto|js))`", text):
        if not PLACEHOLDER.search(named):
            assert (ROOT / named).exists() or Path(named).name in NAMES, named
    for module in re.findall(r"\btests\.bench\.\w+", text):
        assert (ROOT / f"{module.replace('.', '/')}.py").exists() or (ROOT / module.replace(".", "/")).is_dir(), module
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"`make ([\w-]+)", text):
        assert re.search(rf"^(BENCHES := .*\b)?{target}\b", makefile, re.MULTILINE), target


def test_the_map_has_every_part() -> None:
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    parts = [path.parent.name for part in ("bridge", "estimator") for path in (ROOT / part).glob("*/__init__.py")]
    assert [part for part in parts if f"`{part}/`" not in text] == []


def typed(page: Path) -> list[str]:
    """Lines of a page that begin with `truerate`, without what a shell takes for itself."""
    blocks = re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    return [re.sub(r"\s(?:>|&|\|).*", "", line) for line in lines if line.startswith("truerate ")]


@each_page
def test_what_people_are_told_to_type_is_taken(page: Path) -> None:
    for line in typed(page):
        words = shlex.split(line, comments=True)[1:]
        assert words == ["--version"] or build().parse_args(words).run, line


@each_page
def test_verbs_and_options_named_in_a_sentence_exist(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for line in re.findall(r"`truerate ([a-z][^`]*)`", text):
        parser = build()
        words = line.split()
        while words and (inner := verbs(parser)):
            assert words[0] in inner, line
            parser = inner[words.pop(0)]
        for option in (word for word in words if word.startswith("--")):
            assert option in parser.format_help(), line


def verbs(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    return next((a.choices for a in parser._actions if isinstance(a, argparse._SubParsersAction)), {})

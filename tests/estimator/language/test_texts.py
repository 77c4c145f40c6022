"""The texts of the guide and the reports: all of them in every language, with the same fields."""

import re
import tomllib
from string import Formatter

import pytest

from bridge.reasons.codes import Code
from estimator.guide.steps import Picture, Step, Words
from estimator.language.texts import _FOLDER, LANGUAGES, chosen, texts
from estimator.overview.ward import URGENCY


def fields(language: str) -> dict[str, list[str]]:
    """The fields of each text by its dotted key."""
    with (_FOLDER / f"{language}.toml").open("rb") as file:
        sections = tomllib.load(file)
    return {
        f"{section}.{key}": sorted({name for _, name, _, _ in Formatter().parse(text) if name})
        for section, keys in sections.items()
        if isinstance(keys, dict)
        for key, text in keys.items()
    }


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_all_languages_say_the_same(language: str) -> None:
    assert fields(language) == fields(LANGUAGES[0])


def test_everything_the_guide_says_has_a_text() -> None:
    there = fields("en")
    assert {f"how.{step}" for step in Step} <= set(there)
    assert {f"guide.{way}" for way in (Picture.FLAT, Picture.ALONG, Picture.ACROSS)} <= set(there)
    assert {f"head.{kind}_{way}" for kind in ("turn", "again") for way in ("flat", "along", "across")} <= set(there)
    assert {f"state.{state.replace(' ', '_')}" for state in URGENCY} <= set(there)


#: what a nurse reads while she works: tiles, the guide, the queue
_AT_WORK = ("tile", "head", "how", "queue")
_BANNERS = ("rebooted", "idle_log_in", "idle_read_only", "read_only", "log_in", "following", "all_done")


@pytest.mark.parametrize(("language", "most"), [("en", 12), ("zh", 24)])
def test_sentences_for_a_first_day_are_short(language: str, most: int) -> None:
    """At most twelve words, or twenty-four characters of Chinese."""
    with (_FOLDER / f"{language}.toml").open("rb") as file:
        texts_of = tomllib.load(file)
    said = [text for section in _AT_WORK for text in texts_of[section].values()]
    said += [texts_of["guide"][key] for key in _BANNERS]
    sentences = [one.strip() for text in said for one in re.split(r"[.?!。？！]", text) if one.strip()]
    assert [one for one in sentences if len(one.split() if language == "en" else one) > most] == []


def test_values_are_filled_in() -> None:
    short = (Code.TURN_TOO_SHORT(angle_deg="181"),)
    assert texts("en").text(short).startswith("The device turned by about 181°, ")
    assert "181°" in texts("zh").text(short)
    # A name with braces in it is a name.
    assert texts("en").text((Code.CALIBRATION_CANCELLED(who="{n}"),)) == "{n} cancelled the calibration."
    assert texts("en").say("head", Words("idle")) == "It is calibrated"


@pytest.mark.parametrize(
    ("asked", "accepted", "language"),
    [
        (("", ""), "", "en"),
        (("zh", ""), "en", "zh"),
        (("", "zh"), "en", "zh"),
        (("xx", ""), "zh-CN,zh;q=0.9,en;q=0.8", "zh"),
        (("", ""), "de, en;q=0.3, zh;q=0.7", "zh"),
        (("", ""), "zh;q=0, en;q=0.1", "en"),
        (("", ""), "zh;q=x, ;;,", "en"),
    ],
)
def test_which_language(asked: tuple[str, ...], accepted: str, language: str) -> None:
    assert chosen(asked, accepted) == language

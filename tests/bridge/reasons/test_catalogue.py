"""Each code has a text in each language, with exactly its parameters; the wire document lists all of them."""

import ast
from pathlib import Path
from string import Formatter

import pytest

from bridge.reasons.catalogue import LANGUAGES, catalogue, english, in_words, sentences_as_json
from bridge.reasons.codes import Code, Sentence

ROOT = Path(__file__).parents[3]


def fields(text: str) -> set[str]:
    return {name for _, name, _, _ in Formatter().parse(text) if name}


@pytest.mark.parametrize("language", LANGUAGES)
def test_each_code_has_a_text_with_exactly_its_parameters(language: str) -> None:
    texts = catalogue(language).sentences
    assert texts.keys() == {code.value for code in Code}
    assert {code: fields(texts[code]) for code in Code} == {code: set(code.params) for code in Code}


def test_all_languages_have_the_same_labels() -> None:
    assert catalogue("zh").labels.keys() == catalogue("en").labels.keys()


def test_each_code_is_said_by_somebody() -> None:
    said = set[str]()
    for path in (*ROOT.glob("bridge/**/*.py"), *ROOT.glob("estimator/**/*.py")):
        if "guide" in path.parts:  # which only hears
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "Code":
                said.add(node.attr)
    assert {code.name for code in Code} - said == set()


def test_the_wire_document_lists_each_code() -> None:
    rows = [f"| `{code}` | {', '.join(code.params)} | {catalogue('en').sentences[code]} |" for code in Code]
    document = (ROOT / "docs/wire.md").read_text(encoding="utf-8")
    assert "\n".join(rows) in document, "the table of codes is to be:\n" + "\n".join(rows)


def test_sentences_are_said_one_after_the_other() -> None:
    reason = (Code.TURN_TAKEN(axis="x"), Code.TURNS_NEEDED(axes="y, z"))
    assert english(*reason) == "The turn about x was accepted. Turns still needed: y, z."
    assert catalogue("zh").text(reason) == "绕 x 轴的转动已记录。还需要的转动：y, z。"
    assert sentences_as_json(reason)[0] == {
        "code": "turn_taken", "params": {"axis": "x"}, "text": "The turn about x was accepted.",
    }  # fmt: skip


def test_a_code_takes_its_own_parameters_and_no_others() -> None:
    for wrong in ({}, {"axis": "x", "axes": "y"}, {"axes": "x"}):
        with pytest.raises(TypeError, match="turn_taken takes the parameters"):
            Code.TURN_TAKEN(**wrong)


def test_what_a_later_version_says_is_shown_as_it_came() -> None:
    assert english(Sentence("flux_low", {"n": "3"})) == "flux_low (n: 3)"
    assert english(Sentence("turn_taken", {})) == "turn_taken ()"


def test_a_label_is_translated_within_a_sentence() -> None:
    bad = Code.SAMPLES_BAD(percent="12", label="old_boot")
    assert "12 % of the samples were of an earlier boot" in english(bad)
    assert "属于以前的启动" in catalogue("zh").text((bad,))
    assert in_words("zaru: outside the gate") == "zero-rate update: outside the gate"
    assert in_words("something_new") == "something new"

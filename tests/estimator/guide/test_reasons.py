"""What the estimator says is understood, sentence by sentence."""

import ast
import inspect
from types import ModuleType

import pytest

from estimator.batch import axes, recognise, result
from estimator.batch import session as calibrating
from estimator.guide.reasons import said

#: said of recordings only
OFFLINE = "no movement between two rests"


@pytest.mark.parametrize(
    ("reason", "keys"),
    [
        ("a movement of 180°, not a full turn of 360°; still needed: x, y", ["short"]),
        (
            "went back and forth: 520° of movement gained 350°; a pause of 1.2 s in it was too short to be a rest: hold it still",
            ["back_and_forth", "paused"],
        ),
        ("turned faster than the gyro's range for 12 samples: turn more slowly; still needed: x", ["fast"]),
        (
            "turn about x taken; the turn about y no longer counts: it was made 11 minutes ago. Make all three within 10 minutes",
            ["old"],
        ),
        ("the turn about y, z is too old; still needed: x, y, z", ["old"]),
        ("turn about x taken; still needed: y, z", []),
        ("still: now turn it once about x, y, z", []),
        ("hold the device still for 3 seconds", []),
        (
            "hold the device still for 3 seconds (its range is 4, was 8 when it was calibrated: from scratch)",
            ["changed"],
        ),
        ("a nudge, not a turn; still needed: x", []),
        ("calibration cancelled by nurse; the old one stays", ["cancelled"]),
        ("the turn did not end where it began: x by 2.1°, z by 3.0°. Repeat axis x, z", ["open"]),
        (
            "no turn of 360° if the gyro is what its maker says: z 330°. Turn it once around, to where it began. Repeat axis z",
            ["around"],
        ),
        ("something nobody has thought of", ["other"]),
        ("", []),
    ],
)
def test_sentences(reason: str, keys: list[str]) -> None:
    assert [words.key for words in said(reason)] == keys


def test_values_are_taken_along() -> None:
    (words,) = said("not about one axis of the device: 71 % about y; still needed: x")
    assert words.values == {"percent": "71", "axis": "y"}


@pytest.mark.parametrize("module", [recognise, result, axes, calibrating], ids=lambda module: module.__name__)
def test_every_sentence_of_the_estimator_is_known(module: ModuleType) -> None:
    """Whoever rewords one finds out here: each is read from the source, with something in place of what is filled in."""
    unknown = [one for one in _sentences(module) if [words.key for words in said(one)] == ["other"]]
    assert [one for one in unknown if not one.startswith(OFFLINE)] == []


def _sentences(module: ModuleType) -> list[str]:
    """Every text of a module that is a sentence of its own for a person, as f-strings with 7 or x in place of values."""
    found = []
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        match node:
            case ast.Assign(targets=[ast.Name(id="reason")], value=value):
                found.append(_filled(value))
            case ast.Call(func=ast.Name(id="NoTurn"), args=[value, *_]):
                found.append(_filled(value))
            case ast.Return(value=ast.JoinedStr() as value):
                found.append(_filled(value))
    return [one for one in found if " " in one and one[0].isalpha()]


def _filled(node: ast.expr | None) -> str:
    match node:
        case ast.Constant(value=str(words)):
            return words
        case ast.JoinedStr(values=values):
            return "".join(str(part.value) if isinstance(part, ast.Constant) else _value(part) for part in values)
        case ast.BinOp(left=left):
            return _filled(left)
        case _:
            return ""


def _value(part: ast.expr) -> str:
    return (
        "7"
        if (isinstance(part, ast.FormattedValue) and part.format_spec is not None) or "len(" in ast.unparse(part)
        else "x"
    )

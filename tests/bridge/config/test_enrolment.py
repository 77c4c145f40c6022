"""[devices]: what is an enrolment and what is not."""

from pathlib import Path

import pytest

from bridge.config.enrolment import Enrolment, places
from bridge.config.schema import ConfigError, Root, load
from tests.bridge.wire.test_keys import HOSTILE


def test_ids_alone_and_with_their_bridge() -> None:
    assert Enrolment(enrolled=("wrist", "b1/chest")).places == {"wrist": "", "chest": "b1"}


@pytest.mark.parametrize(
    "entry",
    [*(text for text in HOSTILE if text != "a/b"), "/a", "a/", "a/b/c", "*/a", "b1/*"],
    ids=lambda text: ascii(text[:12]),
)
def test_what_is_no_id_is_not_enrolled(entry: str) -> None:
    with pytest.raises(ValueError, match="not valid"):
        places([entry])


def test_two_bridges_of_one_device_are_a_mistake() -> None:
    assert places(["b1/a", "b1/a"]) == {"a": "b1"}
    with pytest.raises(ValueError, match="'a' is enrolled twice, for b1 and for any bridge"):
        places(["b1/a", "a"])


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("", "the key 'enrolled' is missing"),
        ("enrolled = []", "give enrolled"),
        ('enrolled = ["A"]', "'A' is not valid"),
        ('devices = ["a"]', "unknown key 'devices'"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, table: str, words: str) -> None:
    path = tmp_path / "w.toml"
    path.write_text(f'ward = "w"\n[devices]\n{table}\n')
    with pytest.raises(ConfigError) as error:
        load(path, Root)
    assert words in str(error.value)
    assert "[devices]" in str(error.value)

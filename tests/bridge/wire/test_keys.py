"""Keys are built and parsed in one place, and a hostile id never gets through either way."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.wire import keys
from bridge.wire.refusal import Reason, Refusal

HOSTILE = [
    "", "*", "**", "$*", "a*", "a/b", "/", "..", ".", "../../etc/passwd", "a b", " a", "a ", "a\n", "\n", "a\0b",
    "\x1b[2J", "a'b", 'a"b', "a;drop table", "@v1", "#", "?", "A", "Wrist", "é", "ａ", "а", "１", "-a", "_a", "a" * 33,
    "a" * 70_000, "a\u202eb", "a\ud800",
]  # fmt: skip
GOOD = ["a", "0", "wrist-01", "w_1", "a" * 32]
IDS = st.from_regex(keys.ID, fullmatch=True)


@pytest.mark.parametrize("text", HOSTILE, ids=lambda text: ascii(text[:12]))
def test_a_hostile_id_is_refused_on_the_way_out_and_on_the_way_in(text: str) -> None:
    for call in (
        lambda: keys.check_id(text),
        lambda: keys.build("ward", "status", device=text),
        lambda: keys.build(text, "status", device="a"),
        lambda: keys.pattern("ward", "raw", bridge=text),
        lambda: keys.parse(f"{keys.ROOT}/ward/raw/bridge/{text}"),
        lambda: keys.parse(f"{keys.ROOT}/{text}/raw/bridge/device"),
    ):
        with pytest.raises(Refusal):
            call()


@pytest.mark.parametrize("text", GOOD)
def test_a_good_id_passes(text: str) -> None:
    assert keys.check_id(text) == text


@pytest.mark.parametrize("what", keys.SHAPES)
@given(data=st.data())
def test_what_is_built_is_parsed_back(what: str, data: st.DataObject) -> None:
    ids = {name: data.draw(IDS) for name in keys.SHAPES[what]}
    ward = data.draw(IDS)
    parsed = keys.parse(keys.build(ward, what, **ids))
    assert (parsed.ward, parsed.what, parsed.ids) == (ward, what, ids)


def test_a_pattern_has_a_star_for_every_id_not_given() -> None:
    assert keys.pattern("w", "raw", device="d") == "truerate/@v1/w/raw/*/d"
    assert keys.pattern("w", "alive/device") == "truerate/@v1/w/alive/device/*/*"


@pytest.mark.parametrize(
    ("key", "reason"),
    [
        ("", Reason.BAD_KEY),
        ("**", Reason.WILDCARD_KEY),
        ("truerate/@v1/w/raw/*/d", Reason.WILDCARD_KEY),
        ("truerate/@v1/w/raw/$*/d", Reason.WILDCARD_KEY),
        ("truerate/@v2/w/raw/b/d", Reason.BAD_KEY),
        ("truerate/@v1", Reason.BAD_KEY),
        ("truerate/@v1/w", Reason.BAD_KEY),
        ("truerate/@v1/w/alive", Reason.BAD_KEY),
        ("truerate/@v1/w/alive/device/d", Reason.BAD_KEY),
        ("truerate/@v1/w/raw/b", Reason.BAD_KEY),
        ("truerate/@v1/w/raw/b/d/e", Reason.BAD_KEY),
        ("truerate/@v1/w/status//", Reason.BAD_KEY),
        ("truerate/@v1/w/status/", Reason.BAD_ID),
        ("truerate/@v1/" + "a" * 70_000, Reason.BAD_KEY),
    ],
)
def test_a_foreign_key_is_refused_with_its_reason(key: str, reason: Reason) -> None:
    with pytest.raises(Refusal) as refused:
        keys.parse(key)
    assert refused.value.reason is reason
    assert len(refused.value.detail) < 500


def test_ids_that_the_shape_does_not_name_are_our_own_mistake() -> None:
    with pytest.raises(TypeError):
        keys.build("w", "raw", device="d")
    with pytest.raises(TypeError):
        keys.pattern("w", "status", bridge="b")


def test_a_boot_in_a_key_is_an_id() -> None:
    for boot in (0, 1, 2**64 - 1):
        assert keys.check_id(keys.boot_id(boot))

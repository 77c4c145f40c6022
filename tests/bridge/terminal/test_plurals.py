from bridge.terminal.plurals import count


def test_one_is_one_and_the_others_are_many() -> None:
    assert [count(n, "device") for n in (0, 1, 2)] == ["0 devices", "1 device", "2 devices"]
    assert [count(n, "axis", "axes") for n in (1, 3)] == ["1 axis", "3 axes"]

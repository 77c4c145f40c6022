"""Lines of bytes: any chunking, any ends, any length."""

from bridge.framing.lines import ANY_END, Line, Lines

MAX_LINE = 1024


def test_the_first_line_of_an_open_port_may_have_begun_before() -> None:
    lines = Lines(MAX_LINE, ANY_END)
    assert lines.feed(b"2.5\r\n12.5\n\n\r 1 \n7") == [
        Line(b"2.5", begun=True, too_long=False),
        Line(b"12.5", begun=False, too_long=False),
        Line(b" 1 ", begun=False, too_long=False),
    ]
    lines.opened()
    assert lines.feed(b"7\n\n8\n") == [Line(b"7", begun=True, too_long=False), Line(b"8", begun=False, too_long=False)]


def test_a_line_without_an_end_is_cut_and_said_to_be() -> None:
    lines = Lines(MAX_LINE, ANY_END)
    lines.feed(b"\n")
    for _ in range(1000):
        assert lines.feed(b"x" * 999) == []
        assert len(lines._partial) <= MAX_LINE
    long, after = lines.feed(b"\nnext\n")
    assert (len(long.data), long.too_long) == (MAX_LINE, True)
    assert after == Line(b"next", begun=False, too_long=False)

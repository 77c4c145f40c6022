"""Which share of the last samples is no good."""

from bridge.ingest.bad_sample_ratio import BadSampleRatio
from bridge.reasons.codes import Code

S = 1_000_000_000


def test_a_notable_share_of_the_last_minute_is_said_and_passes() -> None:
    shares = BadSampleRatio()
    assert not shares.notable(0, 0, {})
    assert not shares.notable(10 * S, 1000, {"clipped": 10})
    said = shares.notable(20 * S, 2000, {"clipped": 60, "non_finite": 200})
    assert said == (
        Code.SAMPLES_BAD(percent="10", label="non_finite"),
        Code.SAMPLES_BAD(percent="3", label="clipped"),
    )
    assert not shares.notable(80 * S, 8000, {"clipped": 60, "non_finite": 200})

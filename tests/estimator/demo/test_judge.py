"""The demonstration comes out right only where scale, bias and heading are: each by itself is judged."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.demo.judge import Judgement, in_words

RIGHT = Judgement(
    device="chest", boot=1, k_true=np.ones(3), k=np.full(3, 1.005), k_std=np.full(3, 0.002), time=np.arange(4.0),
    bias_true_dps=np.zeros((4, 3)), bias_dps=np.full((4, 3), 0.04), bias_std_dps=np.full((4, 3), 0.01),
    raw_heading_deg=np.array([0.0, 20.0, 60.0, 80.0]), corrected_heading_deg=np.array([0.0, 1.0, -4.0, 1.0]),
)  # fmt: skip


@pytest.mark.parametrize(
    ("change", "good"),
    [
        ({}, True),
        ({"k": np.array([1.0, 1.0, 1.015])}, False),
        ({"k": np.array([1.0, 1.0, 1.015]), "k_std": np.full(3, 0.005)}, True),
        ({"k": np.array([1.0, 1.0, 1.03]), "k_std": np.full(3, 0.5)}, False),
        ({"bias_dps": np.full((4, 3), 0.1)}, False),
        ({"bias_dps": np.full((4, 3), 0.1), "bias_std_dps": np.full((4, 3), 0.03)}, True),
        ({"bias_dps": np.full((4, 3), 0.3), "bias_std_dps": np.full((4, 3), 1.0)}, False),
        ({"corrected_heading_deg": np.array([0.0, -9.0, -4.0, 1.0])}, False),
    ],
)
def test_what_is_off_by_more_than_it_may_is_not_good(change: dict[str, object], *, good: bool) -> None:
    assert replace(RIGHT, **change).good is good  # type: ignore[arg-type]


def test_it_says_how_far_the_heading_was_off_at_its_worst() -> None:
    assert in_words(RIGHT) == (
        "heading off by up to +80° raw, -4.00° corrected; scale within 0.50%, bias within 0.040 °/s"
    )

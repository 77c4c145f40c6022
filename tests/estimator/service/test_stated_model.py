"""A device that states its model is tracked with that model's noise and bias, unless the ward file tells another."""

from dataclasses import replace
from math import radians

import pytest

from bridge.config.enrolment import Enrolment
from estimator.config.schema import Estimator
from tests.estimator.served import Served
from tests.estimator.stream import NAME, calibration, info

#: largest turn-on bias of generic.toml, mpu-6050.toml and factory-calibrated.toml, °/s
GENERIC, MPU, FACTORY = 5.0, 20.0, 0.5


@pytest.mark.parametrize(
    ("stated", "told", "turn_on_dps"),
    [
        ("no such chip", Estimator(id="e"), GENERIC),
        ("Movella DOT XS-T01", Estimator(id="e"), FACTORY),
        ("Movella DOT XS-T01", Estimator(id="e", model="generic"), GENERIC),
        ("Movella DOT XS-T01", Estimator(id="e", models={NAME: "mpu-6050"}), MPU),
    ],
)
def test_the_first_samples_have_the_bias_of_the_model(stated: str, told: Estimator, turn_on_dps: float) -> None:
    batches = calibration(seed=1).batches()
    with Served(Enrolment(enrolled=(NAME,)), settings=told) as served:
        served.tell(info(model=stated))
        served.put(batches[0])
        first = served.round()
        served.tell(info(2, model="MPU-6050"))
        served.put(replace(batches[0], boot=2, sequence=0))
        second = served.round(0.1)
    assert first[0].bias_std == pytest.approx([radians(turn_on_dps)] * 3, rel=0.01)
    if not told.model and not told.models:
        assert second[-1].bias_std == pytest.approx([radians(MPU)] * 3, rel=0.01), "at its next boot it states another"

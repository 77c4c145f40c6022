"""Tables, figures and claims of the paper that can be computed, with the paper's values.

Source: L. Wang et al., "In-field gyroscope autocalibration with iterative attitude estimation", Mechatronics 102 (2024)
103232. Figures 1, 3, 4 and 5 are photographs and drawings; table 1 is the sensors' settings, as in configs/study/sensors.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Item:
    """One table, figure or claim of the paper.

    key: as in Finding.item. where: place in the paper. says, value: the claim and its value. study: name of the study that
    computes it.
    """

    key: str
    where: str
    says: str
    value: str
    study: str


ITEMS = (
    Item(
        "before", "Fig. 2", "Orientation by raw readings over ±360° about x, y, z", "significant error", "orientation"
    ),
    Item("typical", "Fig. 6", "A typical simulated session at 0.15 °/s", "one rest, three turns", "typical"),
    Item(
        "errors",
        "Fig. 7",
        "Errors of bias and scale in 15,000 simulated sessions: unbiased, most of them in a band",
        "median zero; ±5.5e-3 at 0.03 °/s, ±2.5e-2 at 0.15 °/s",
        "errors",
    ),
    Item(
        "testset",
        "Fig. 8, eq. 12",
        "Mean error of the rate on a test set, before and after",
        "3 % of before, at 0.03 °/s",
        "testset",
    ),
    Item("lsm9ds1", "Table 2", "LSM9DS1: four methods", "k within 0.0245, b within 0.0215 °/s (proposed)", "sensors"),
    Item(
        "icm-20948", "Table 3", "ICM20948: four methods", "k within 0.0088, b within 0.0067 °/s (proposed)", "sensors"
    ),
    Item("limits", "Abstract", "Errors of scale and bias are below", "2.5e-2 LSM9DS1, 1e-2 ICM20948", "sensors"),
    Item(
        "time",
        "Abstract, §4.5",
        "Calibrated in less than 30 s, accelerometer-aided accuracy in a twentieth of the time",
        "27 and 29 s; 570 and 565 s accelerometer-aided",
        "sensors",
    ),
    Item(
        "magnitude",
        "Fig. 9",
        "Magnitude of 25.42 °/s before and after",
        "after closer; ICM20948 coincides",
        "magnitude",
    ),
    Item(
        "after", "Fig. 10", "Orientation by calibrated rates over ±360°", "almost coincides with ideal", "orientation"
    ),
    Item("noise", "§4.4", "The estimates are biased by noise, and less so with less noise", "no figure", "analysis"),
    Item(
        "discretization", "§4.4", "The discretization error falls as the sampling rate rises", "no figure", "analysis"
    ),
    Item(
        "physical",
        "§2.3, §4.4",
        "Speed, direction and re-placement of the hand: the accuracy stays acceptable",
        "no figure",
        "analysis",
    ),
)

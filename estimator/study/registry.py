"""Registry: all studies by name, in the order of the report."""

from typing import Any

from estimator.study import analysis, errors, magnitude, orientation, real, sensors, testset, typical
from estimator.study.study import Study

STUDIES: dict[str, Study[Any, Any]] = {
    module.STUDY.name: module.STUDY
    for module in (typical, errors, testset, sensors, magnitude, orientation, analysis, real)
}

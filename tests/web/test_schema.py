"""The OpenAPI document and the server agree, whatever is asked: schemathesis, in this process."""

import contextlib
import time
from collections.abc import Iterator
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, given, settings
from hypothesis.errors import Unsatisfiable
from schemathesis import Case, GenerationMode
from schemathesis.core.result import Ok

from estimator.web.api import openapi
from estimator.web.stream import request
from tests.web.asking import PASSWORD, Asking
from tests.web.talk import about, said

pytestmark = [
    pytest.mark.xdist_group("schema"),
    pytest.mark.timeout(300),
    pytest.mark.filterwarnings("default"),  # its own, not ours
]


@pytest.fixture(scope="module")
def asking() -> object:
    with pytest.MonkeyPatch.context() as patch:  # nobody waits for samples here
        for name, of_schema, s in (("USUAL_S", "default", 0.0), ("LONGEST_S", "maximum", 0.01)):
            patch.setattr(request, name, s)
            schema: Any = openapi._WAIT["schema"]
            patch.setitem(schema, of_schema, s)
        openapi.document.cache_clear()
        yield from _asking()
    openapi.document.cache_clear()


def _asking() -> Iterator[Asking]:
    made = Asking(hosts=("testserver",))
    with made.client:
        made.hear(about("chest", boot=5), said("chest", boot=5, time_ns=time.time_ns()))
        yield made
    made.talk.hush()


MODES = {"as told": GenerationMode.POSITIVE, "otherwise": GenerationMode.NEGATIVE}


@pytest.mark.parametrize("mode", MODES)
def test_the_document_is_kept(asking: Asking, mode: str) -> None:
    schema = schemathesis.openapi.from_asgi("/api/v1/openapi.json", asking.server.app)
    tried = set()
    for found in schema.get_all_operations():
        assert isinstance(found, Ok)
        operation = found.ok()
        tried.add(operation.label)

        @settings(max_examples=25, derandomize=True, database=None, suppress_health_check=list(HealthCheck))
        @given(case=operation.as_strategy(generation_mode=MODES[mode]))
        def try_it(case: "Case[Any]") -> None:
            if case.method == "POST":
                case.headers["Authorization"] = f"Bearer nurse.{PASSWORD}"
            case.call_and_validate()

        with contextlib.suppress(Unsatisfiable):  # there is nothing that can be wrong with it
            try_it()
    assert len(tried) == 10

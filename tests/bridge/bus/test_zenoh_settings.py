"""How long who is silent is taken for alive: long enough for a busy machine, short enough for what is promised."""

import json
from typing import Any

import zenoh

from bridge.bus import zenoh_settings
from estimator.config.schema import Estimator

ENDPOINTS = ["tcp/127.0.0.1:7447"]
HANGING_ESTIMATOR_S = 1.5  # by then others know
BUSY_S = 1.0  # a process may be held up for so long


def told(settings: dict[str, Any]) -> tuple[float, float]:
    """The lease as zenoh itself understands it, and how long after a sign of life the next one is due."""
    transmit = json.loads(zenoh.Config.from_json5(json.dumps(settings)).get_json("transport/link/tx"))
    return transmit["lease"] / 1000, transmit["lease"] / 1000 / transmit["keep_alive"]


def test_a_client_that_hangs_is_known_in_time_and_one_that_is_held_up_is_not_lost() -> None:
    lease_s, sign_s = told(zenoh_settings.client(ENDPOINTS))
    assert lease_s < HANGING_ESTIMATOR_S
    assert lease_s - sign_s > BUSY_S


def test_a_router_that_hangs_is_known_before_its_silence_is_held_against_devices() -> None:
    lease_s, sign_s = told(zenoh_settings.router(ENDPOINTS, []))
    assert lease_s < Estimator(id="e").silence_s
    assert lease_s - sign_s > BUSY_S

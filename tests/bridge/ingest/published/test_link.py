"""One device's thread: what fails is told once, tried again, and silences nobody."""

import pytest

from bridge.transport.errors import DeviceUnavailable
from tests.bridge.ingest.published.scripted import HELLO, Scripted, run, said
from tests.sentences import free


def test_the_first_failure_is_loud_and_repeats_are_quiet(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO", "bridge.ingest.device_thread")
    missing = [DeviceUnavailable(*free("script: missing")) for _ in range(3)]
    driver = Scripted(*missing, [HELLO, said(0)])
    taken = run(driver, lambda _: driver.opened == 4 and not driver._script).take()
    assert [record.message for record in caplog.records] == ["d1: script: missing", "d1: reading again from script"]
    assert sum(map(len, taken.batches)) == 10


def test_a_drivers_own_fault_does_not_silence_its_device(caplog: pytest.LogCaptureFixture) -> None:
    driver = Scripted([HELLO, said(0)], ZeroDivisionError("oops"), [HELLO, said(10)])
    taken = run(driver, lambda _: driver.opened == 2 and not driver._script).take()
    assert sum(map(len, taken.batches)) == 20
    assert "driver failed: ZeroDivisionError('oops')" in caplog.text

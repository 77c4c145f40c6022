"""Where an optional package is not installed, a device that needs it says what to install; its driver is listed all the same."""

import subprocess
import sys

CODE = """
import importlib.util, sys
found, absent = importlib.util.find_spec, {"pymavlink", "pylsl", "bleak_retry_connector"}
importlib.util.find_spec = lambda name, *rest: None if name in absent else found(name, *rest)
from bridge.config.schema import Device
from bridge.drivers import registry
assert {"mavlink", "lsl"} <= registry.kinds().keys()
for table in (
    {"driver": "mavlink", "port": "/dev/x"},
    {"driver": "lsl", "name": "x"},
    {"driver": "native", "port": "ble://C4:64:E3:12:34:56/ffe4"},
):
    try:
        Device.from_table({"id": "d", **table})
    except ValueError as error:
        print(error)
assert not {"pymavlink", "pylsl", "bleak"} & sys.modules.keys()
"""


def test_what_it_needs_is_said() -> None:
    """In a Python of its own, where the packages cannot be found."""
    ran = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    mavlink, lsl, ble = ran.stdout.strip().splitlines()
    assert "pip install 'truerate[mavlink]'" in mavlink
    assert "pip install 'truerate[lsl]'" in lsl
    assert ble == "port 'ble://C4:64:E3:12:34:56/ffe4' needs another package: pip install 'truerate[ble]'"

"""What each protocol looks like when all is well: whole messages, to be damaged."""

import itertools

import numpy as np
from pymavlink.dialects.v20 import common

from bridge.framing.cobs_frames import frame
from bridge.framing.packets import Data, Hello, encode_data, encode_hello
from tests.bridge.drivers import dot_device, shimmer3_device
from tests.bridge.drivers.mtdata2_device import MtDevice
from tests.bridge.drivers.witmotion_device import WitDevice
from tests.bridge.framing import ximu3_encode
from tests.bridge.text.printed import PRINTS

_ONES = np.ones((3, 3), np.float32)


def _native(sequence: int) -> bytes:
    ticks = (np.arange(3) * 9600 + sequence).astype(np.uint32)
    return frame(encode_data(Data(1, sequence, ticks, _ONES, 9 * _ONES, 20 * _ONES[:, 0])))


def _ximu3(first: int) -> bytes:
    return b"".join(ximu3_encode.inertial(np.arange(first, first + 3) * 10_000, _ONES, 9 * _ONES))


def _mavlink(i: int) -> bytes:
    rest = (0.2, 0.1, 0.4, 1013.0, 0.0, 30.0, 36.5, 0xFFFF)
    message = common.MAVLink_highres_imu_message(5000 * i, 0.1, 0.2, -9.8, 0.1, -0.2, 0.3, *rest)
    return bytes(message.pack(common.MAVLink(None, srcSystem=1, srcComponent=1)))


def _witmotion() -> list[bytes]:
    device = WitDevice()
    device.registers[0x02] = 0x1F
    return [device.cycle() for _ in range(3)]


def _mtdata2() -> list[bytes]:
    device = MtDevice()
    return [device.measure() for _ in range(3)] + [device.power_up()]


def _movella_dot() -> list[bytes]:
    dot = dot_device.Dot()
    values = [dot_device.value(number, dot.read(number)) for number in (dot_device.INFO, dot_device.BATTERY)]
    rates = [dot_device.rates(16_667 * i, (0.1 * i, 1.0, -2.0)) for i in range(40)]
    return [*values, *(dot_device.value(dot_device.MEDIUM, one) for one in rates)]


def _shimmer3() -> list[bytes]:
    head = b"\xff", b"\xff\x25\x03", b"\xff\x4a\x01", shimmer3_device.calibrations(), shimmer3_device.inquiry()
    packets = [shimmer3_device.packet(320 * i, (i, 2, 3)) for i in range(40)]
    summed = [shimmer3_device.summed(one) for one in (*packets, b"\xff\x8a\x94\x22\x0b\x80", b"\x8a\x71\x10")]
    return [
        b"".join(map(shimmer3_device.summed, head)),
        *head,
        *summed,
        *(a + b for a, b in itertools.pairwise(packets)),
    ]


# A list of messages for each driver that has a decoder, and each profile of text.
SEEDS: dict[str, list[bytes]] = {
    "mavlink": [_mavlink(i) for i in range(40)],
    "native": [frame(encode_hello(Hello(1, 1e-6, 104.0, 4.3, True, True, "model", "1.2"))), _native(0), _native(3)],
    "ximu3": [
        *(_ximu3(3 * i) for i in range(20)),
        ximu3_encode.temperature(5, 36.5) + ximu3_encode.battery(6, 80.0, charging=True),
        ximu3_encode.notification(7, "Button pressed."),
        b"I,1000000,0.0000,0.0000,0.0000,0.0000,0.0000,1.0000\r\nT,1000000,25.0000\nF,1000000,Battery empty.\n",
        b'{"ping":{"interface":"USB","name":"x-IMU3","sn":"0123-4567-89AB-CDEF"}}\n{"firmware_version":"v1.2"}\n',
        b'{"gyroscope_offset_correction_enabled":true}\n{"inertial_message_rate_divisor":8}\n',
    ],
    "movella_dot": _movella_dot(),
    "mtdata2": _mtdata2(),
    "shimmer3": _shimmer3(),
    "witmotion": _witmotion(),
    **{f"text_profile {name}": prints(10).splitlines(keepends=True) for name, prints in PRINTS.items()},
}

"""What devices print, line by line as their public sketches do: a start, then rows of a slow turn."""

import math

CRLF = "\r\n"
_ARTEMIS = ("aX", "aY", "aZ", "gX", "gY", "gZ", "mX", "mY", "mZ", "imu_degC", "output_Hz")


def turn(i: int) -> tuple[float, float, float]:
    """Row i of a turn, °/s."""
    return 1.5 + 0.01 * i, -40.0 * math.sin(i / 9), 0.07 * i - 3


def nano(rows: int, start: bool = True) -> bytes:
    head = ["Started", "Gyroscope sample rate = 119.00 Hz", "", "Gyroscope in degrees/second", "X\tY\tZ"]
    body = ["\t".join(f"{value:.2f}" for value in turn(i)) for i in range(rows)]
    return _lines(head * start + body)


def icm(rows: int, start: bool = True) -> bytes:
    def padded(value: float) -> str:
        return f"{'-' if value < 0 else ' '}{abs(value):08.2f}"

    def three(values: tuple[float, float, float]) -> str:
        return ", ".join(padded(value) for value in values)

    head = ["Initialization of the sensor returned: All is well.", "Waiting for data"]
    body = [
        f"Scaled. Acc (mg) [ {three((12.2, -3.9, 998.05))} ], Gyr (DPS) [ {three(turn(i))} ], "
        f"Mag (uT) [ {three((12.3, 20.85, -41.1))} ], Tmp (C) [ {padded(27.43)} ]"
        for i in range(rows)
    ]
    return _lines(head * start + body)


def artemis(rows: int, start: bool = True, *, micros: bool = True, first_us: int = 5_000_000, ready: int = 1) -> bytes:
    """ready: the IMU has news at each but every `ready`th row, if that is more than 1; without, its columns are missing."""
    head = ["Artemis OpenLog v2.8", "SD card online", "IMU online"]
    names = ["rtcDate", "rtcTime", *["micros"] * micros, *_ARTEMIS]
    head.append(",".join([*names, ""]))
    body = []
    for i in range(rows):
        row = ["09/12/2025", f"10:22:{i // 100 % 60:02d}.{i % 100:02d}"]
        row += [str((first_us + 10_000 * i) % 2**32)] * micros
        if ready == 1 or i % ready:
            row += [
                "12.21",
                "-3.91",
                "998.05",
                *(f"{value:.2f}" for value in turn(i)),
                "1.05",
                "2.40",
                "-8.25",
                "30.50",
            ]
        body.append(",".join([*row, "100.000", ""]))
    return _lines(head * start + body)


def razor(rows: int, start: bool = True, *, first_ms: int = 1200) -> bytes:
    del start  # it prints nothing as it starts
    body = [
        ", ".join(
            [
                str((first_ms + 10 * i) % 2**32),
                "0.01",
                "-0.02",
                "1.00",
                *(f"{v:.2f}" for v in turn(i)),
                "7.05",
                "-2.10",
                "40.35",
            ]
        )
        for i in range(rows)
    ]
    return _lines(body)


def adafruit(rows: int, start: bool = True) -> bytes:
    head = ["Adafruit AHRS - IMU Calibration!"]
    body = []
    for i in range(rows):
        dps = turn(i)
        raw = [int(v * 8192 / 9.8) for v in (0.1, -0.2, 9.79)] + [int(v * 16) for v in dps] + [70, -21, 403]
        body.append("Raw:" + ",".join(map(str, raw)))
        uni = (
            [f"{v:.2f}" for v in (0.1, -0.2, 9.79)]
            + [f"{math.radians(v):.4f}" for v in dps]
            + ["7.05", "-2.10", "40.35"]
        )
        body.append("Uni:" + ",".join(uni))
        if i % 50 == 49:
            body.append("Cal1:0.000,0.000,0.000,0.000,0.000,0.000,0.000,0.000,0.000,50.000")
            body.append("Cal2:1.0000,0.0000,0.0000,0.0000,1.0000,0.0000,0.0000,0.0000,1.0000")
    return _lines(head * start + body)


def _lines(lines: list[str]) -> bytes:
    return "".join(line + CRLF for line in lines).encode()


# Who prints what, by profile.
PRINTS = {
    "adafruit-raw": adafruit,
    "adafruit-uni": adafruit,
    "icm-20948-sparkfun": icm,
    "nano-33-ble": nano,
    "openlog-artemis": artemis,
    "razor-m0": razor,
}

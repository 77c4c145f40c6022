# ruff: noqa: E501 - headers as tools write them are long
"""Tables as tools export them are read as they are, or with the one option that the message names."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from bridge.recording import Reading, load
from tests.bridge.recording.text.session import G, refusal, right, table, turns

TIME, GYRO, ACCEL = turns()
RAD, M_S2 = np.radians(GYRO), ACCEL * G
MAG = np.full((len(TIME), 3), 20.0)
CLOCKS = [f"10:{30 + int(t) // 60:02d}:{t % 60:06.3f}" for t in TIME]


def joined(texts: list[str], rows: list[str], separator: str = ",") -> list[str]:
    return [f"{text}{separator}{row}" for text, row in zip(texts, rows, strict=True)]


SAID = {
    "x-io": (
        [
            "Time (s),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s),Accelerometer X (g),Accelerometer Y (g),Accelerometer Z (g)"
        ],
        table([TIME, GYRO, ACCEL]),
    ),
    "phyphox, decimal comma, tabs": (
        ["Time (s)\tGyroscope x (rad/s)\tGyroscope y (rad/s)\tGyroscope z (rad/s)"],
        [row.replace(".", ",") for row in table([TIME, RAD], "\t", "%.9E")],
    ),
    "phyphox, quoted": (
        ['"Time (s)";"Gyroscope x (rad/s)";"Gyroscope y (rad/s)";"Gyroscope z (rad/s)";"Absolute (rad/s)"'],
        table([TIME, RAD, np.ones(len(TIME))], ";"),
    ),
    "MetaWear": (
        ["epoch (ms),time (01:00),elapsed (s),x-axis (deg/s),y-axis (deg/s),z-axis (deg/s)"],
        [
            f"{1560000000000 + round(t * 1000)},2019-06-08T14.20.{t:06.3f},{t:.3f},{row}"
            for t, row in zip(TIME, table([GYRO]), strict=True)
        ],
    ),
    "Polar Sensor Logger": (
        ["Phone timestamp;sensor timestamp [ns];X [dps];Y [dps];Z [dps]"],
        [
            f"2022-01-05T{clock};{599616000000000000 + round(t * 1e9)};{row}"
            for clock, t, row in zip(CLOCKS, TIME, table([GYRO], ";"), strict=True)
        ],
    ),
    "three rows: sensor, axis, unit": (
        [
            "Time,Accelerometer,,,Gyroscope,,,Magnetometer,,",
            ",X,Y,Z,X,Y,Z,X,Y,Z",
            "s,m/s^2,m/s^2,m/s^2,rad/s,rad/s,rad/s,uT,uT,uT",
        ],
        table([TIME, M_S2, RAD, MAG]),
    ),
    "AndroSensor": (
        [
            "ACCELEROMETER X (m/s²);ACCELEROMETER Y (m/s²);ACCELEROMETER Z (m/s²);GYROSCOPE X (rad/s);GYROSCOPE Y (rad/s);GYROSCOPE Z (rad/s);Time since start in ms ;YYYY-MO-DD HH-MI-SS_SSS"
        ],
        joined(table([M_S2, RAD, TIME * 1000], ";"), ["2024-05-01 10-00-00_000"] * len(TIME), ";"),
    ),
    "ROS": (
        [
            "%time,field.header.seq,field.angular_velocity.x [rad/s],field.angular_velocity.y [rad/s],field.angular_velocity.z [rad/s],field.linear_acceleration.x [m/s^2],field.linear_acceleration.y [m/s^2],field.linear_acceleration.z [m/s^2]"
        ],
        [
            f"{1600000000000000000 + round(t * 1e9)},{i},{row}"
            for i, (t, row) in enumerate(zip(TIME, table([RAD, M_S2]), strict=True))
        ],
    ),
    "a rate and units above the header": (
        [
            "# firmware 1.2",
            "# sample rate: 50 Hz",
            "# gyro unit: deg/s",
            "# accelerometer unit: g",
            "gx,gy,gz,ax,ay,az",
        ],
        table([GYRO, ACCEL]),
    ),
    "padded with blanks": (["   t_s   gx_dps   gy_dps   gz_dps"], table([TIME, GYRO], " ", "%12.5f")),
    "times of day": (["time,gx_dps,gy_dps,gz_dps"], joined(CLOCKS, table([GYRO]))),
    "over midnight": (
        ["time,gx_dps,gy_dps,gz_dps"],
        joined(
            [
                f"{(86390 + t) % 86400 // 3600:02.0f}:{(86390 + t) % 3600 // 60:02.0f}:{(86390 + t) % 60:06.3f}"
                for t in np.floor(TIME * 1000) / 1000
            ],
            table([GYRO]),
        ),
    ),
}
SAID["two rows of names"] = (
    [
        "Time,Accelerometer,Accelerometer,Accelerometer,Gyroscope,Gyroscope,Gyroscope",
        "us,X (m/s^2),Y (m/s^2),Z (m/s^2),X (rad/s),Y (rad/s),Z (rad/s)",
    ],
    table([TIME * 1e6, M_S2, RAD]),
)
SAID["two rows of names, units in brackets"] = (
    ["Time,Acceleration,,,Angular Velocity,,", "(s),X(g),Y(g),Z(g),X(deg/s),Y(deg/s),Z(deg/s)"],
    table([TIME, ACCEL, GYRO]),
)
SAID["German"] = (
    ["Zeit (s);Gyroskop x (rad/s);Gyroskop y (rad/s);Gyroskop z (rad/s)"],
    [row.replace(".", ",") for row in table([TIME, RAD], ";", "%.9E")],
)
SAID["camel case"] = (
    ["timestampMs,accelX(g),accelY(g),accelZ(g),gyroX(dps),gyroY(dps),gyroZ(dps)"],
    table([1.7e12 + TIME * 1000, ACCEL, GYRO]),
)
SAID["per"] = (
    ["time_ms,angular_rate_x_deg_per_s,angular_rate_y_deg_per_s,angular_rate_z_deg_per_s"],
    table([TIME * 1000, GYRO]),
)
SAID["iOS"] = (
    [
        "loggingTime(txt),motionTimestamp_sinceReboot(s),motionRotationRateX(rad/s),motionRotationRateY(rad/s),motionRotationRateZ(rad/s),motionUserAccelerationX(G),motionUserAccelerationY(G),motionUserAccelerationZ(G)"
    ],
    [f"2024-05-01 {clock} +0200,{row}" for clock, row in zip(CLOCKS, table([TIME + 1e5, RAD, ACCEL * 0]), strict=True)],
)


SAID["names over three columns, and units"] = (
    ["Time,Accelerometer,,,Gyroscope,,,Barometer", "us,m/s^2,m/s^2,m/s^2,rad/s,rad/s,rad/s,kPa"],
    table([TIME * 1e6, M_S2, RAD, np.full(len(TIME), 101.3)]),
)
SAID["the sensor's name before the quantity's"] = (
    [
        "X[s],Gyro 1: Gyro.X 1 [deg/s],Gyro 1: Gyro.Y 1 [deg/s],Gyro 1: Gyro.Z 1 [deg/s],Gyro 1: Acc.X 1 [g],Gyro 1: Acc.Y 1 [g],Gyro 1: Acc.Z 1 [g]"
    ],
    table([TIME, GYRO, ACCEL]),
)
SAID["a row per reading"] = (
    [
        "% ACCE;AppTimestamp(s);SensorTimestamp(s);Acc_X(m/s^2);Acc_Y(m/s^2);Acc_Z(m/s^2);Accuracy(integer)",
        "% GYRO;AppTimestamp(s);SensorTimestamp(s);Gyr_X(rad/s);Gyr_Y(rad/s);Gyr_Z(rad/s);Accuracy(integer)",
    ],
    [
        f"{tag};{row};3"
        for a, g in zip(table([TIME, TIME, M_S2], ";"), table([TIME, TIME, RAD], ";"), strict=True)
        for tag, row in (("ACCE", a), ("GYRO", g))
    ],
)


@pytest.mark.parametrize("tool", SAID)
def test_what_says_its_units_is_read_as_it_is(tmp_path: Path, tool: str) -> None:
    header, rows = SAID[tool]
    path = tmp_path / "session.csv"
    path.write_text("\n".join([*header, *rows]) + "\n", encoding="utf-8")
    right(path)


ASKED = {
    "no unit": (["t,Ax,Ay,Az,Gx,Gy,Gz"], table([TIME, ACCEL, GYRO]), "--gyro-unit deg/s", Reading(gyro_unit="deg/s")),
    "no unit, radians": (["timestamp,gyro_x,gyro_y,gyro_z"], table([TIME * 1e9, RAD]), "--gyro-unit rad/s", Reading(gyro_unit="rad/s")),
    "counts": (
        ["time,gx,gy,gz,ax,ay,az"],
        table([TIME * 1000, np.rint(GYRO * 131), np.rint(ACCEL * 16384)], ",", "%.0f"),
        "--gyro-sensitivity",
        Reading(gyro_sensitivity=131.0),
    ),
    "no time": (["gyro_x (deg/s),gyro_y (deg/s),gyro_z (deg/s)"], table([GYRO]), "--rate-hz", Reading(rate_hz=50.0)),
    "no header": ([], table([TIME, GYRO, ACCEL]), "--columns 2,3,4 --gyro-unit deg/s", Reading(columns=("2", "3", "4"), gyro_unit="deg/s", time_column="1")),
    "a row per reading": (
        ["sensor,time_ns,x,y,z"],
        [
            f"{tag},{row}"
            for a, g in zip(table([TIME * 1e9, M_S2]), table([TIME * 1e9, RAD]), strict=True)
            for tag, row in (("accelerometer", a), ("gyroscope", g))
        ],
        "--gyro-unit rad/s",
        Reading(gyro_unit="rad/s"),
    ),
    "names of nothing": (
        ["a1;a2;a3;a4"],
        table([TIME, GYRO], ";"),
        "--columns NAME,NAME,NAME --gyro-unit deg/s",
        Reading(columns=("a2", "a3", "a4"), gyro_unit="deg/s", time_column="a1"),
    ),
    "two sensors": (
        ["t_s,raw_gyro_x_dps,raw_gyro_y_dps,raw_gyro_z_dps,cal_gyro_x_dps,cal_gyro_y_dps,cal_gyro_z_dps"],
        table([TIME, GYRO, GYRO]),
        "choose one sensor, such as --columns cal_gyro_x_dps,cal_gyro_y_dps,cal_gyro_z_dps",
        Reading(columns=("cal_gyro_x_dps", "cal_gyro_y_dps", "cal_gyro_z_dps")),
    ),
    "one name twice": (
        ["t_s,gx_dps,gy_dps,gz_dps,gx_dps,gy_dps,gz_dps"],
        table([TIME, GYRO, GYRO]),
        "'gx_dps' more than once; choose by number with --columns 2,3,4",
        Reading(columns=("2", "3", "4")),
    ),
    "two units that disagree": (
        ["t_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,gx_dps,gy_dps,gz_dps"],
        table([TIME, GYRO, GYRO]),
        "differ even in the same unit; choose one with --columns gx_dps,gy_dps,gz_dps",
        Reading(columns=("gx_dps", "gy_dps", "gz_dps")),
    ),
    "two times that disagree": (
        ["t_s,t_ms,gx_dps,gy_dps,gz_dps"],
        table([TIME, TIME * 2000, GYRO]),
        "the time columns disagree: 't_s' at 50 Hz; 't_ms' at 25 Hz. Choose one, such as --time-column 't_s'",
        Reading(time_column="t_s"),
    ),
    "a unit of time that cannot be": (
        ["t_us,gx_dps,gy_dps,gz_dps"],
        table([TIME * 1e9, GYRO]),
        "Give the right --time-unit (ms, us, ns)",
        Reading(time_unit="ns"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", ASKED)
def test_what_is_not_said_is_asked_for_and_the_advice_is_right(tmp_path: Path, case: str) -> None:
    header, rows, advice, reading = ASKED[case]
    path = tmp_path / "session.csv"
    path.write_text("\n".join([*header, *rows]) + "\n")
    assert advice in refusal(path)
    right(path, reading)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"])
def test_any_encoding_is_read(tmp_path: Path, encoding: str) -> None:
    header, rows = ["Time (s);Gyroscope X (°/s);Gyroscope Y (°/s);Gyroscope Z (°/s)"], table([TIME, GYRO], ";")
    path = tmp_path / "session.txt"
    path.write_text("\n".join([*header, *rows]), encoding=encoding)
    right(path, Reading(gyro_unit="deg/s") if encoding == "latin-1" else None)


def test_gzip_is_read_and_a_damaged_one_refused(tmp_path: Path) -> None:
    text = "\n".join(["t_s,gx_dps,gy_dps,gz_dps", *table([TIME, GYRO])]).encode()
    path = tmp_path / "session.csv.gz"
    path.write_bytes(gzip.compress(text))
    right(path)
    path.write_bytes(gzip.compress(text)[:-500])
    assert "damaged .gz file" in refusal(path)


def test_the_accelerometer_may_be_in_a_file_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "Gyroscope.csv").write_text(
        "\n".join(["time,seconds_elapsed,z,y,x", *table([TIME + 5, TIME, GYRO[:, ::-1] * np.pi / 180], form="%.9f")])
    )
    half = slice(0, None, 2)
    (tmp_path / "TotalAcceleration.csv").write_text(
        "\n".join(["time,seconds_elapsed,z,y,x", *table([TIME[half] + 5, TIME[half], M_S2[half, ::-1]])])
    )
    reading = Reading(accel_file=str(tmp_path / "TotalAcceleration.csv"))
    assert "the accelerometer is read from TotalAcceleration.csv" in right(tmp_path / "Gyroscope.csv", reading)
    recording = load(tmp_path / "Gyroscope.csv", reading=reading)
    assert recording.accel is not None
    assert np.allclose(recording.accel[:-1:2], M_S2[half], atol=1e-4)


def test_rows_of_several_sensors_keep_their_accelerometer(tmp_path: Path) -> None:
    path = tmp_path / "session.csv"
    header, rows = SAID["a row per reading"]
    path.write_text("\n".join([*header, *rows]))
    accel = load(path).accel
    assert accel is not None
    assert np.allclose(accel, M_S2, atol=1e-5)


def test_a_tool_of_ones_own(tmp_path: Path) -> None:
    tool = tmp_path / "mine.toml"
    tool.write_text('gyro = { columns = ["c", "d", "e"], sensitivity = 131.0 }\ntime = { column = "b", unit = "ms" }\n')
    path = tmp_path / "session.csv"
    path.write_text("\n".join(["b,c,d,e", *table([TIME * 1000, GYRO * 131])]))
    right(path, Reading(columns=(str(tool),)))


def test_a_unit_that_is_told_replaces_the_files_and_that_is_said(tmp_path: Path) -> None:
    path = tmp_path / "session.csv"
    path.write_text("\n".join(["t_s,gx_dps,gy_dps,gz_dps", *table([TIME, RAD], form="%.9f")]))
    assert "the header states deg/s; --gyro-unit replaces it" in right(path, Reading(gyro_unit="rad/s"))


def test_a_wide_header_is_read_in_linear_time_and_named_shortly(tmp_path: Path) -> None:
    path = tmp_path / "wide.csv"
    path.write_text(",".join(f"column{i}" for i in range(40_000)) + "\n" + ",".join(["1"] * 40_000) + "\n")
    said = refusal(path)
    assert "(40000 in all)" in said
    assert len(said) < 600


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the file is empty: give a header row"),
        ("\n\n", "the file is empty: give a header row"),
        ("t_s,gx_dps,gy_dps,gz_dps\n", "no rows of numbers; the file begins with 't_s,gx_dps"),
        ("t_s,gx_dps,gy_dps,gz_dps\n0,1,2,3\n", "1 sample; at least 2"),
        ("t_s,gx_dps,gy_dps,gz_dps\n0,1,2,3\n1,2,x,3\n", "'gy_dps' is not a finite number in line 3 (1 such value)"),
        (
            "t_s,gx_dps,gy_dps,gz_dps\n0,1,2,1e9\n0.01,1,2,3\n",
            "'gz_dps' is 1.74533e+07 rad/s in line 2; at most ±1000 rad/s",
        ),
        (
            "rate_hz,gx_dps,gy_dps,gz_dps\n50,1,1,1\n51,1,1,1\n",
            "'rate_hz' differs between rows; give the rate with --rate-hz",
        ),
    ],
)
def test_a_table_that_cannot_be_read_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    assert said in refusal(path)

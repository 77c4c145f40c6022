"""Encoding of accelerometer calibrations inside other messages."""

from bridge.wire import truerate_pb2 as pb
from bridge.wire import validation
from bridge.wire.messages import AccelerometerCalibration, Verdict
from bridge.wire.sentences import decoded, encoded

_MOST_POSES = 1000
_MOST_BIAS, _MOST_SCALE, _MOST_VAR = 100.0, 10.0, 1e6


def accelerometer_message(one: AccelerometerCalibration | None) -> pb.AccelerometerCalibration | None:
    """Convert an accelerometer calibration to its protobuf message; None for None."""
    if one is None:
        return None
    return pb.AccelerometerCalibration(
        verdict=one.verdict,  # type: ignore[arg-type] # an int, whatever the stub says
        reason=encoded(one.reason),
        poses=one.poses,
        bias=one.bias,
        scale=one.scale,
        covariance=one.covariance,
        cross_std=one.cross_std,
    )


def accelerometer_in(raw: pb.Status | pb.Calibration) -> AccelerometerCalibration | None:
    """Validate the accelerometer calibration inside a received message and convert it; None where the message has none.

    Raises Refusal.
    """
    if not raw.HasField("accelerometer"):
        return None
    one = raw.accelerometer
    verdict = validation.member(Verdict, one.verdict, "verdict")
    n = 3 if verdict is Verdict.ACCEPTED else 0
    return AccelerometerCalibration(
        verdict,
        decoded(one.reason, "reason"),
        validation.whole(one.poses, "poses", _MOST_POSES),
        tuple(validation.vector(one.bias, "bias", n, -_MOST_BIAS, _MOST_BIAS).tolist()),
        tuple(validation.vector(one.scale, "scale", n, 0.0, _MOST_SCALE).tolist()),
        tuple(validation.vector(one.covariance, "covariance", 4 * n * n, -_MOST_VAR, _MOST_VAR).tolist()),
        validation.number(one.cross_std, "cross_std", 0.0, 1.0),
    )

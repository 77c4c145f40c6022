"""truerate in Python: load a recording, calibrate a gyroscope, correct its rates, subscribe to a ward.

    import truerate

    session = truerate.Recording.from_arrays(gyro, accel, rate_hz=104.0)  # rad/s, m/s²
    result, passed_over = truerate.calibrate(session)
    print(result.verdict.name, truerate.explain(result.reason), result.scale, result.bias)
    day = truerate.correct(truerate.load("day.npz"), result)
    print(day.rate, day.rate_std, day.quality)

    with truerate.Client(ward="demo") as ward:
        for batch in ward.corrected("chest"):
            print(batch.rate, batch.rate_std)

Rates are in rad/s in the device's frame, specific force in m/s², times in s. This module is the public API; everything
else in the packages `bridge` and `estimator` may change without notice.
"""

from bridge.reasons.catalogue import explain
from bridge.recording import Recording, load
from estimator.client import Client
from estimator.offline.recordings import calibrate, correct

__all__ = ["Client", "Recording", "calibrate", "correct", "explain", "load"]

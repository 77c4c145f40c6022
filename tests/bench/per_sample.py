"""What `--per-sample` adds to a recorder's processor time and to its file: twenty devices with orientation, a minute.

python -m tests.bench.per_sample [--devices 20] [--seconds 60]
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

from bridge.bus.contract import Message
from bridge.recording.files import Folder
from bridge.recording.recorder import WardRecorder
from bridge.recording.settings import Recorder
from bridge.wire import codec, keys
from tests.bridge.recording.crowd import RATE_HZ, STEP, WARD, corrected, samples
from tests.bridge.recording.test_per_sample import orientation

BATCH = 10


def minute(devices: int, seconds: float, begin_ns: int) -> list[list[Message]]:
    """What comes in each round."""
    rounds = []
    for sequence in range(0, int(seconds * RATE_HZ), BATCH):
        messages = list[Message]()
        for device in (f"d{number}" for number in range(devices)):
            batch = samples(device, sequence, BATCH, begin_ns + sequence * STEP * 1000)
            turned = orientation(device, sequence, BATCH, batch.start_time_ns)
            messages += [
                Message(keys.build(WARD, "raw", bridge="bridge-1", device=device), codec.encode_samples(batch)),
                Message(keys.build(WARD, "corrected", device=device), codec.encode_corrected(corrected(batch))),
                Message(keys.build(WARD, "orientation", device=device), codec.encode_orientation(turned)),
            ]
        rounds.append(messages)
    return rounds


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--devices", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=60.0)
    given = parser.parse_args()
    begin_ns, found = time.time_ns(), dict[bool, tuple[float, float]]()
    rounds = minute(given.devices, given.seconds, begin_ns)
    for per_sample in (False, True):
        with tempfile.TemporaryDirectory() as folder:
            settings = Recorder(keep_free_mb=0.0, per_sample=per_sample)
            recorder = WardRecorder(Folder(Path(folder), WARD), WARD, settings)
            recorder.begin(begin_ns, 0.0)
            spent_s = -time.process_time()
            for number, messages in enumerate(rounds):
                recorder.take(messages, begin_ns, number * BATCH / RATE_HZ)
                recorder.tick(begin_ns, number * BATCH / RATE_HZ)
            recorder.close()
            spent_s += time.process_time()
            found[per_sample] = spent_s / given.seconds, recorder.account.files[0].stat().st_size / 1e6
    (plain, plain_mb), (more, more_mb) = found[False], found[True]
    print(
        f"{given.devices} devices for {given.seconds:g} s: {plain:.1%} of a core and {plain_mb:.1f} MB; with --per-sample"
        f" {more:.1%} and {more_mb:.1f} MB, {more_mb / plain_mb:.1f} times as much"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())

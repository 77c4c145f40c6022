"""A subscriber on a machine of its own: says as JSON, a line a batch or statement, what it was given.

`python -m tests.bench.network.listener WARD.toml`
"""

import json
import sys
import time

from bridge.toml.loader import load
from bridge.wire import codec, keys
from estimator.client import Client, Miss
from estimator.config.schema import Ward

#: who does not want to miss anything waits for a router that is gone, and for repeats through lines that lose packets
PATIENT_S = 40.0
#: samples that are older when they come are late
OLD_S = 1.3


def say(**what: object) -> None:
    print(json.dumps({"at": time.monotonic()} | what), flush=True)


def missed(miss: Miss) -> None:
    say(what="miss", device=miss.device, boot=miss.boot, first=miss.first, n=miss.count, told=miss.told)


def main(config: str) -> None:
    """Until it is killed."""
    ward = load(config, Ward)
    with Client(ward.bus.every()[0], ward=ward.ward) as client:
        owned = client._bus.subscribe(keys.pattern(ward.ward, "owned"))
        stream = client.corrected(wait_s=PATIENT_S, on_miss=missed)
        say(what="ready")
        while True:
            for batch in stream.drain(0.02):
                say(
                    what="batch",
                    device=batch.device,
                    boot=batch.boot,
                    first=batch.sequence,
                    n=len(batch),
                    epoch=batch.epoch,
                    good=batch.quality.name == "GOOD",
                    age=time.time() - batch.start_time_ns / 1e9,
                    old=int((time.time() - batch.sample_time_ns / 1e9 > OLD_S).sum()),
                )
            for message in owned.drain(4096, 0.0):
                said = codec.decode_owned(message.key, message.payload)
                held = {h.device: h.epoch for h in said.holdings}
                say(what="owned", estimator=said.estimator, held=held, part=said.part)


if __name__ == "__main__":
    main(sys.argv[1])

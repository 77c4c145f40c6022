"""Runs benchmarks and prints one table of them: `make bench`, or a group of them by `make bench-GROUP ARGS=…`.

What each prints is left in out/bench. A group of one benchmark prints by itself.
"""

import subprocess
import sys
import time
from pathlib import Path

from rich.console import Console

from bridge.terminal.tables import Column, Columns

GROUPS = {
    "calibration": ("closure_honesty",),
    "tracking": ("tracking", "cost", "honesty"),
    "broad": ("real_movement",),
    "orientation": ("orientation",),
    "load": ("load",),
    "bridge": ("reload",),
    "cluster": ("cluster",),
    "network": ("network",),
    "faults": ("suffering", "estimator_kills", "store_faults", "router_kills", "kills"),
    "hostile": ("access", "attacks"),
    "outlets": ("lsl", "stream", "foxglove"),
    "storage": ("storage", "reading"),
    "viewers": ("subscribing", "dashboard", "newcomer", "agreement"),
}
OUT = Path("out/bench")


def main(words: list[str]) -> int:
    """Run the groups that are named, or all; further arguments go to each benchmark. 1 when one of them missed a goal."""
    named = [word for word in words if word in GROUPS]
    arguments = [word for word in words if word not in GROUPS]
    benches = [bench for group in named or GROUPS for bench in GROUPS[group]]
    if len(benches) == 1:
        return subprocess.call(_command(benches[0], arguments))
    console, failed = Console(), False
    table = Columns(
        [Column("benchmark"), Column("result"), Column("minutes", number=True), Column("its last line", least=30)]
    )
    OUT.mkdir(parents=True, exist_ok=True)
    for bench in benches:
        console.print(f"{bench} …", style="dim")
        begun, path = time.monotonic(), OUT / f"{bench}.txt"
        with path.open("wb") as file:
            code = subprocess.call(_command(bench, arguments), stdout=file, stderr=subprocess.STDOUT)
        lines = path.read_text(errors="replace").strip().splitlines() or [""]
        failed |= bool(code)
        result = "done" if code == 0 else "goal missed" if code == 1 else f"failed: {code}"
        table.add(bench, result, f"{(time.monotonic() - begun) / 60:.1f}", lines[-1].strip())
    console.print(table)
    console.print(f"all that they print is in {OUT}")
    return int(failed)


def _command(bench: str, arguments: list[str]) -> list[str]:
    return [sys.executable, "-m", f"tests.bench.{bench}", *arguments]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

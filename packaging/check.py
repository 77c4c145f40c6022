"""Installs the release in dist/ on a new Debian 12, uses, upgrades, downgrades and removes it, and prints a table.

`make release-check`, as root, after `make release ARGS=x86_64`. Needs Debian's packages debootstrap, systemd-container,
lintian, chromium, libnss3-tools, podman and buildah. The new machine has its own systemd and no network; it shares kernel, clock
and processors with this machine. The containers need a network.
Exit code 1 if a check failed.
"""

import json
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from containers import containers
from machine import Machine, debootstrap, wait
from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parent.parent
DIST = ROOT / "dist"
SERVICES = ("router", "bridge", "estimator", "dashboard", "recorder")
#: subscriber that starts before the ward, and ends with the first sample corrected by an accepted calibration
SUBSCRIBER = """
from truerate import Client
with Client(ward="ward-3") as ward:
    for batch in ward.corrected("virtual-1"):
        if batch.quality.name == "GOOD":
            print("first corrected sample", batch.rate[-1], "+/-", batch.rate_std[-1])
            break
"""
#: address and name of the machine in docs/install.md
ADDRESS, NAME = "10.0.0.5", "ward-3.example"
Row = tuple[str, str, bool]


def main() -> int:
    """Run all checks; returns the exit code."""
    package, bundle = next(DIST.glob("*_amd64.deb")), next(DIST.glob("*-x86_64.tar.gz"))
    debootstrap(ROOT / "out/bookworm")
    rows = list[Row]()
    with tempfile.TemporaryDirectory(dir=ROOT / "out") as folder:
        work = Path(folder)
        for name, checks in (("package", _package), ("bundle", _bundle)):
            root = work / name
            subprocess.run(["cp", "-a", "--reflink=auto", str(ROOT / "out/bookworm"), str(root)], check=True)
            (root / "etc/hosts").write_text(f"127.0.0.1 localhost ward\n{ADDRESS} {NAME}\n")
            (root / "etc/hostname").write_text("ward\n")
            with Machine(root) as machine:
                for row in checks(machine, package if name == "package" else bundle, work):
                    print(*row, flush=True)
                    rows.append(row)
            shutil.rmtree(root)
        for row in chain(containers(package, work, SUBSCRIBER), [_lintian(package)]):
            print(*row, flush=True)
            rows.append(row)
    table = Table("check", "measured", "")
    for what, measured, passed in rows:
        table.add_row(what, measured, "pass" if passed else "FAIL")
    Console().print(table)
    return 0 if all(passed for *_, passed in rows) else 1


def _package(machine: Machine, package: Path, work: Path) -> Iterator[Row]:
    """Follow docs/install.md word by word, then upgrade, go back, remove and purge."""
    newer = _renamed(package, work)
    for path in (package, newer):
        shutil.copy(path, machine.root / "root")
    machine.network("ip", "address", "add", f"{ADDRESS}/32", "dev", "lo")
    text = (ROOT / "docs/install.md").read_text()
    install, init, doctor, virtual, restart = re.findall(r"^sudo .*$", text, re.MULTILINE)[:5]
    begun = time.monotonic()
    done = machine.run(install)
    yield install, f"{time.monotonic() - begun:.0f} s{_why(done)}", done.returncode == 0
    done = machine.run(init)
    passwords = dict(re.findall(r"^password of (\w+) .*: (\S+)$", done.stderr, re.MULTILINE))
    yield init, f"{time.monotonic() - begun:.0f} s from the start{_why(done)}", done.returncode == 0
    yield _doctor(machine, doctor)
    done = machine.run(virtual)
    yield virtual, f"{time.monotonic() - begun:.0f} s from the start{_why(done)}", done.returncode == 0
    (machine.root / "root/subscriber.py").write_text(SUBSCRIBER)
    done = machine.run("timeout 300 /opt/truerate/bin/python3 subscriber.py")
    seconds = time.monotonic() - begun
    yield (
        "first corrected sample, from apt install",
        f"{seconds:.0f} s{_why(done)}",
        done.returncode == 0 and seconds <= 300,
    )
    yield _running(machine, "services run, under systemd's restrictions")
    yield _doctor(machine, doctor)
    yield _tablets(machine, passwords, restart)
    done = machine.run("sudo -u truerate truerate people list --config /etc/truerate/ward.toml")
    people = done.stdout
    yield "people, as the page changed them", " ".join(people.split()), "joy" in people
    done = machine.run("systemctl start truerate-backup && ls /var/lib/truerate/backups")
    yield "nightly backup", done.stdout.strip() + _why(done), done.returncode == 0 and bool(done.stdout.strip())
    yield _restored(machine, people)
    done = machine.run("systemctl kill -s KILL truerate-estimator; sleep 8; systemctl is-active truerate-estimator")
    yield "killed estimator is started again", done.stdout.strip(), done.returncode == 0
    units = "/usr/lib/systemd/system/truerate*.service /usr/lib/systemd/system/truerate*.t*"
    done = machine.run(f"systemd-analyze verify {units}")
    said = "\n".join(line for line in done.stderr.splitlines() if "truerate" in line)
    yield "systemd-analyze verify", said or "clean", done.returncode == 0 and not said
    levels = [
        re.findall(r"level for \S+: (\S+)", machine.run(f"systemd-analyze security truerate-{name}").stdout)
        for name in (*SERVICES, "backup")
    ]
    exposures = [float(level[0]) for level in levels if level]
    yield "systemd-analyze security", f"exposure {exposures}", len(exposures) == 6 and max(exposures) < 3
    before = _data(machine)
    for what, path in (("upgrade", newer), ("downgrade", package)):
        done = machine.run(f"apt-get install -y --allow-downgrades ./{path.name}")
        version = machine.run("dpkg-query -W -f '${Version}' truerate").stdout
        yield what, f"to {version}{_why(done)}", done.returncode == 0
        yield _running(machine, f"services run after the {what}")
        yield _kept(machine, before)
    for what in ("remove", "purge"):
        done = machine.run(f"apt-get {what} -y truerate")
        left = [path for path in ("opt/truerate", "usr/bin/truerate") if (machine.root / path).exists()]
        left += machine.run("pgrep -u truerate -a").stdout.splitlines()
        yield what, f"left of the program: {left or 'nothing'}{_why(done)}", done.returncode == 0 and not left
    done = machine.run(f"apt-get install -y ./{package.name}")
    yield "installed again", f"exit code {done.returncode}{_why(done)}", done.returncode == 0
    yield _kept(machine, before)


def _doctor(machine: Machine, command: str) -> Row:
    done = machine.run(command)
    troubles = re.findall("^✗ .*", done.stdout, re.MULTILINE)
    return command, "; ".join(troubles) or f"no trouble{_why(done)}", done.returncode == 0


def _tablets(machine: Machine, passwords: dict[str, str], restart: str) -> Row:
    """Calibrate on two tablets over TLS, as the how-to says."""
    words = [sys.executable, str(ROOT / "packaging/tablet.py"), f"https://{NAME}:8443/", ADDRESS]
    words += [str(machine.root / "etc/truerate/pki/ca.pem"), "virtual-1", passwords["nurse"], passwords["chief"]]
    with machine.started(*words) as tablets:
        assert tablets.stdout is not None
        if tablets.stdout.readline().strip() == "turn the device":
            machine.run(restart)
        said, failed = tablets.communicate(timeout=300)
    what = "calibrated from a second browser over TLS; a person added"
    return what, said.strip() or failed.strip()[-500:], tablets.returncode == 0


def _restored(machine: Machine, people: str) -> Row:
    """Delete the store and the people, and restore both from the nightly backup, as docs/upgrade.md says."""
    done = machine.run(
        "systemctl stop truerate-estimator && cd /var/lib/truerate && rm -f ward.sqlite3* people.toml"
        " && sudo -u truerate truerate store restore $(ls backups/ward-*T*.sqlite3 | tail -1) --config /etc/truerate/ward.toml"
        " && systemctl start truerate-estimator"
    )
    found = machine.run("sudo -u truerate truerate people list --config /etc/truerate/ward.toml").stdout
    return (
        "restored with its people",
        f"{' '.join(found.split())}{_why(done)}",
        done.returncode == 0 and found == people,
    )


def _bundle(machine: Machine, bundle: Path, _work: Path) -> Iterator[Row]:
    """Install the bundle without a network and without root, and run the demo."""
    shutil.copy(bundle, machine.root / "srv")
    folder = bundle.name.removesuffix(".tar.gz")
    machine.run("useradd -m someone")
    begun = time.monotonic()
    done = machine.run(f"runuser -l someone -c 'tar xzf /srv/{bundle.name} && {folder}/install.sh --prefix ~/truerate'")
    yield "bundle, without network or root", f"{time.monotonic() - begun:.0f} s{_why(done)}", done.returncode == 0
    done = machine.run("runuser -l someone -c '~/truerate/bin/truerate demo'")
    yield "demo of the bundle", f"exit code {done.returncode}{_why(done)}", done.returncode == 0


def _running(machine: Machine, what: str) -> Row:
    """Check that all services are active, and that no service restarted in the meantime."""
    names = " ".join(f"truerate-{name}" for name in SERVICES)
    passed = wait(40, lambda: machine.run(f"systemctl is-active {names}").returncode == 0)
    return what, " ".join(machine.run(f"systemctl is-active {names}").stdout.split()), passed


def _data(machine: Machine) -> tuple[str, set[str]]:
    """Checksums of the configuration, and the calibrations in the store."""
    sums = machine.run("find /etc/truerate -type f | sort | xargs sha256sum").stdout
    calibrations = set[str]()
    for n in (1, 2, 3):
        words = f"truerate history virtual-{n} --config /etc/truerate/ward.toml --json"
        history = json.loads(machine.run(f"sudo -u truerate {words}").stdout or "{}")
        calibrations |= {json.dumps(one, sort_keys=True) for one in history.get("calibrations", [])}
    return sums, calibrations


def _kept(machine: Machine, before: tuple[str, set[str]]) -> Row:
    """Check that the configuration is the same, and that no calibration is missing."""
    sums, calibrations = _data(machine)
    passed = sums == before[0] and before[1] <= calibrations and bool(before[1])
    files = f"{len(sums.splitlines())} files {'equal' if sums == before[0] else 'CHANGED'}"
    measured = f"{files}, {len(before[1] & calibrations)} of {len(before[1])} calibrations"
    return "configuration and store kept", measured, passed


def _renamed(package: Path, work: Path) -> Path:
    """The same package with a higher version."""
    tree, newer = work / "tree", work / "truerate_newer.deb"
    subprocess.run(["dpkg-deb", "-R", str(package), str(tree)], check=True)
    control = tree / "DEBIAN/control"
    control.write_text(re.sub(r"^Version: (.*)$", r"Version: \1+check", control.read_text(), flags=re.MULTILINE))
    subprocess.run(
        ["dpkg-deb", "-b", "-Zzstd", "-z1", "--root-owner-group", str(tree), str(newer)],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    shutil.rmtree(tree)
    return newer


def _lintian(package: Path) -> Row:
    done = subprocess.run(
        ["lintian", "--no-cfg", "--allow-root", str(package)], capture_output=True, text=True, check=False
    )
    tags = sorted(set(re.findall(r"^[EW]: \S+: (\S+)", done.stdout, re.MULTILINE)))
    return "lintian", ", ".join(tags) or "no error, no warning", not tags and done.returncode == 0


def _why(done: "subprocess.CompletedProcess[str]") -> str:
    """The last lines of a command that failed."""
    return "" if done.returncode == 0 else "\n" + "\n".join((done.stdout + done.stderr).strip().splitlines()[-6:])


if __name__ == "__main__":
    sys.exit(main())

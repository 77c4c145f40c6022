"""Runs the containers of docs/install.md, word by word, with podman, as a new user of this machine who is not root.

check.py uses this module. Needs Debian's packages debootstrap, podman, buildah and uidmap, and a network, for Debian's packages
in the image and podman-compose from PyPI. The user sees cgroups of version 2, as on any Debian 12.
"""

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Self

from machine import debootstrap

ROOT = Path(__file__).parent.parent
BASE = "docker.io/library/debian:bookworm-slim"
COMPOSE = "podman-compose==1.6.0"
Row = tuple[str, str, bool]


class User:
    """Context of a new user whose containers share the image's files; the exit removes containers and home."""

    def __init__(self, name: str) -> None:
        subprocess.run(["useradd", "--create-home", name], check=True)
        self.name, self.home = name, Path("/home", name)
        done = self.run(
            "mkdir -p -m 700 run .config/containers && echo '[storage]\ndriver=\"overlay\"' > .config/containers/storage.conf"
        )
        done.check_returncode()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.run("podman rm --all --force --time 5; podman unshare rm -rf .local; podman system migrate")
        subprocess.run(["userdel", "--remove", self.name], check=False, stderr=subprocess.DEVNULL)

    def run(self, command: str, folder: str = "") -> "subprocess.CompletedProcess[str]":
        """Run a shell command as this user. folder: below home."""
        words = ["unshare", "--mount", "sh", "-c", 'mount -t cgroup2 none /sys/fs/cgroup && exec "$@"', "sh"]
        words += ["runuser", "-u", self.name, "--", "sh", "-c", command]
        return subprocess.run(
            words,
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            cwd=self.home / folder,
            timeout=900,
            check=False,
            env={
                "HOME": str(self.home),
                "XDG_RUNTIME_DIR": str(self.home / "run"),
                "PATH": f"{self.home}/compose/bin:/usr/sbin:/usr/bin:/sbin:/bin",
            },
        )


def containers(package: Path, work: Path, subscriber: str) -> Iterator[Row]:
    """Build the image, make a ward of simulated devices, run its services, and wait for a corrected sample."""
    section = (ROOT / "docs/install.md").read_text().partition("## In containers")[2].partition("\n## ")[0]
    build, init, up, doctor = re.findall(r"^(?:buildah|podman|podman-compose) .*$", section, re.MULTILINE)
    with User("truerate-check") as user:
        for path in (package, ROOT / "packaging"):
            to = user.home / "truerate" / path.relative_to(ROOT)
            to.parent.mkdir(parents=True, exist_ok=True)
            (shutil.copytree if path.is_dir() else shutil.copy)(path, to)
        _base(user, work / "base")
        done = user.run(f"/usr/bin/python3 -m venv compose && compose/bin/pip install --quiet {COMPOSE}")
        yield COMPOSE, _said(done), done.returncode == 0
        for command in (build, f"{init} --virtual 3", up):
            done = user.run(command, "truerate")
            yield command, _said(done), done.returncode == 0
        command = f"timeout 300 podman exec truerate_estimator_1 /opt/truerate/bin/python3 -c '{subscriber}'"
        done = user.run(command)
        yield "first corrected sample of the containers", _said(done), done.returncode == 0
        done = user.run(doctor)
        yield doctor, "; ".join(re.findall("^✗ .*", done.stdout, re.MULTILINE)) or "no trouble", done.returncode == 0
        done = user.run(
            "podman exec truerate_bridge_1 grep -E '^(Cap(Eff|Bnd)|NoNewPrivs)' /proc/1/status; podman top -l huser"
        )
        yield "privileges of a container", " ".join(done.stdout.split()), _confined(done.stdout)


def _base(user: User, folder: Path) -> None:
    """Give the user the base image, made by debootstrap."""
    debootstrap(folder, "apt")
    archive = user.home / "base.tar"
    subprocess.run(["tar", "--numeric-owner", "-C", str(folder), "-cf", str(archive), "."], check=True)
    done = user.run(f"podman import base.tar {BASE}")
    if done.returncode:
        raise RuntimeError(f"podman import: {done.stderr}")
    archive.unlink()


def _confined(status: str) -> bool:
    """Check that the process has no capability, cannot gain one, and does not run as root on this machine."""
    capabilities = re.findall(r"^Cap\w+:\s+0{16}$", status, re.MULTILINE)
    return len(capabilities) == 2 and "NoNewPrivs:\t1" in status and "root" not in status


def _said(done: "subprocess.CompletedProcess[str]") -> str:
    """The last line of a command, or the last lines of one that failed."""
    return "\n".join((done.stdout + done.stderr).strip().splitlines()[-1 if done.returncode == 0 else -6 :])

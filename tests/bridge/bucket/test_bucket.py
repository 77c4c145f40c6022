"""Copies in a bucket, with a real S3 server: whole files only, tried again, and never over another file."""

import sys
from datetime import timedelta
from pathlib import Path

import pytest

from bridge.bucket.bucket import S3, Bucket, BucketError
from bridge.bucket.mirror import Mirror
from bridge.reasons.codes import Code
from bridge.toml.loader import ConfigError
from tests.bridge.bucket.server import Server, needed
from tests.bridge.bus.worlds import eventually


def fault(mirror: Mirror) -> str:
    return "" if mirror.fault is None else mirror.fault.sentence.code


@needed
def test_finished_files_are_copied_again_after_failures_and_replace_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("bridge.bucket.bucket.RETRY", timedelta(seconds=0.2))
    server, here = Server(tmp_path), tmp_path / "here"
    here.mkdir()
    big = here / "big.mcap"
    big.write_bytes(bytes(range(256)) * 50_000)  # more than one part
    mirror = Mirror(Bucket(server.settings(bucket="ward/site"), "w"), "rec", lambda: sorted(here.iterdir()), look_s=0.1)
    eventually(lambda: fault(mirror) == Code.BUCKET_FAILS)
    with server:
        eventually(lambda: mirror.has(big))
        eventually(lambda: mirror.fault is None)
        assert server.names() == ["site/w/rec/big.mcap"]
        assert (server.objects / "site/w/rec/big.mcap").read_bytes() == big.read_bytes()
        (here / "empty.mcap").touch()
        eventually(lambda: "site/w/rec/empty.mcap" in server.names())
        big.write_bytes(b"another")
        eventually(lambda: fault(mirror) == Code.BUCKET_HAS_ANOTHER)
        assert (server.objects / "site/w/rec/big.mcap").stat().st_size == 256 * 50_000
        big.unlink()
        eventually(lambda: mirror.fault is None)
        (here / "last.mcap").write_bytes(b"written as the program ends")
        mirror.close()
        assert "site/w/rec/last.mcap" in server.names()
        told: list[tuple[int, int]] = []
        bucket = Bucket(server.settings(bucket="ward/site"), "w")
        bucket.download("rec/big.mcap", tmp_path / "back", lambda done, of: told.append((done, of)))
        assert (tmp_path / "back").read_bytes() == bytes(range(256)) * 50_000
        assert told[-1] == (256 * 50_000, 256 * 50_000)
        assert bucket.copies("rec")[0][1:] == ("last.mcap", 27)
    assert sum("cannot be used" in one.message for one in caplog.records) == 1, "a failure that lasts is said once"
    assert "has all copies again" in caplog.text


@needed
def test_what_the_storage_refuses_is_said_by_its_own_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with Server(tmp_path) as server:
        server.keys.write_text(server.keys.read_text().replace("= secret", "= wrong"))
        with pytest.raises(BucketError, match="Bucket ward cannot be used: SignatureDoesNotMatch") as refused:
            Bucket(server.settings(), "w").copies("rec")
        assert refused.value.sentence.code == Code.BUCKET_FAILS
        monkeypatch.setenv("AWS_ACCESS_KEY_ID", "nurse")
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
        by_environment = server.settings(credentials_file="")
        assert Bucket(by_environment, "w").copies("rec") == []
        with pytest.raises(BucketError, match="Bucket nowhere cannot be used: NoSuchBucket"):
            Bucket(server.settings(credentials_file="", bucket="nowhere"), "w").copies("rec")


def test_keys_stand_in_no_file_that_others_can_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(name, raising=False)
    file = tmp_path / "keys"
    told = S3(endpoint="https://s3.example", bucket="b", credentials_file=str(file))
    with pytest.raises(ConfigError, match=r"in credentials_file .*keys .*No such file"):
        told.keys()
    file.write_text("[default]\naws_access_key_id = a%b\naws_secret_access_key = c\n")
    file.chmod(0o644)
    with pytest.raises(ConfigError, match=f"chmod 600 {file}"):
        told.keys()
    file.chmod(0o600)
    assert told.keys() == ["a%b", "c"]
    file.write_text("aws_access_key_id = a\n")
    with pytest.raises(ConfigError, match="AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY not found in credentials_file"):
        told.keys()
    with pytest.raises(ConfigError, match=r"AWS_ACCESS_KEY_ID and .* not found in the environment"):
        S3(endpoint="https://s3.example", bucket="b").keys()
    for endpoint in ("http://s3.example", "https://", "s3.example", "http://127.0.0.1.example"):
        with pytest.raises(ValueError, match=r"use https://HOST, or http://127.0.0.1:PORT on this machine"):
            S3(endpoint=endpoint, bucket="b")
    file.write_text("[default]\naws_access_key_id = a\naws_secret_access_key = c\n")
    monkeypatch.setitem(sys.modules, "obstore", None)
    with pytest.raises(ConfigError, match=r"pip install 'truerate\[s3\]'"):
        Bucket(told, "w")

"""The files in configs/zenoh are what `truerate pki router` writes, and `truerate config check` finds their rules right."""

import json
from pathlib import Path

import pytest

from bridge.bus import router_check, router_file
from bridge.bus.contract import BusError
from bridge.pki.folder import Folder
from bridge.pki.identity import Identity
from bridge.pki.member import Member
from estimator.cli import main

FILES = Path(__file__).parents[3] / "configs" / "zenoh"
AT = Folder(Path("/etc/truerate/pki"))
WARD = [
    *("bridge:bridge-1", "bridge:bridge-2", "estimator:estimator-1", "viewer:hall", "commander:desk"),
    *("recorder:recorder-1", "router:hospital"),
]
HOSPITAL = [
    ("ward-3", "router:router-3"),
    ("ward-4", "router:router-4"),
    ("ward-3", "viewer:office"),
    ("ward-4", "viewer:office"),
]
LISTEN = ["tls/0.0.0.0:7447"]


def identity(router: str) -> Identity:
    return AT.gate(Member.parse(router))


def written() -> dict[str, str]:
    """Each file as it is to be."""
    plain = router_file.plain(["tcp/127.0.0.1:7447"])
    ward = router_file.guarded(LISTEN, identity("router:router-3"), [("ward-3", Member.parse(who)) for who in WARD])
    places = [(ward, Member.parse(who)) for ward, who in HOSPITAL]
    join = ["tls/ward-3.example:7447", "tls/ward-4.example:7447"]
    hospital = router_file.guarded(LISTEN, identity("router:hospital"), places, join)
    titles = {
        "one-machine": "A ward on one machine: nobody else reaches its router, so nobody is asked who he is.",
        "ward": (
            "The router of ward-3 on machines of its own: who has a certificate is let in, to what its role may.\n"
            "An example with names of its own; yours: truerate pki router router:router-3 --ward ward-3"
            " --listen tls/0.0.0.0:7447 --at /etc/truerate/pki"
        ),
        "hospital": (
            "A router that joins two wards: each ward's router speaks and listens for its own ward alone.\n"
            "An example with names of its own; yours: truerate pki router router:hospital --ward ward-3 --ward ward-4\n"
            "--member router:router-3@ward-3 --member router:router-4@ward-4 --member viewer:office --listen tls/0.0.0.0:7447\n"
            "--join tls/ward-3.example:7447 --join tls/ward-4.example:7447 --at /etc/truerate/pki"
        ),
    }
    settings = {"one-machine": plain, "ward": ward, "hospital": hospital}
    return {name: router_file.rendered(settings[name], title) for name, title in titles.items()}


@pytest.mark.parametrize("name", written())
def test_a_file_is_as_it_would_be_written_now(name: str) -> None:
    assert (FILES / f"{name}.json5").read_text("utf-8") == written()[name], (
        "write it anew: python -m tests.bridge.pki.test_shipped_files"
    )


@pytest.mark.parametrize("name", written())
def test_nothing_is_wrong_with_it(name: str) -> None:
    assert router_check.read(FILES / f"{name}.json5").faults == ()


BREAKS = [
    ('"adminspace": {"enabled": false}', '"adminspace": {"enabled": true}', "adminspace.enabled must be false"),
    ('"gossip": {"enabled": false}', '"gossip": {"enabled": true}', "scouting.gossip.enabled must be false"),
    ('"mode": "router"', '"mode": "peer"', "mode is 'peer'"),
    ('"wait_before_close": 100000', '"wait_before_close": 5000000', "one frozen reader silences a ward"),
    ('"enable_mtls": true', '"enable_mtls": false', "enable_mtls must be true"),
    ('"close_link_on_expiration": true', '"close_link_on_expiration": false', "close_link_on_expiration must be true"),
    ('"default_permission": "deny"', '"default_permission": "allow"', "with default_permission 'deny'"),
    ("ward-3/raw/bridge-1/*", "ward-3/raw/*/*", "'bridge:bridge-1 says (ward-3)' is not that of its role"),
    ("tls/0.0.0.0:7447", "tcp/0.0.0.0:7447", "whoever reaches it reads and commands the ward"),
    ('"cert_common_names": ["viewer:hall"]', '"interfaces": ["lo"]', "each subject is one common name"),
    ('"permission": "allow"', '"permission": "deny"', "a rule that denies"),
]


@pytest.mark.parametrize(("good", "bad", "words"), BREAKS)
def test_what_was_changed_for_the_worse_is_named(good: str, bad: str, words: str, tmp_path: Path) -> None:
    text = (FILES / "ward.json5").read_text("utf-8")
    assert good in text
    changed = tmp_path / "router.json5"
    changed.write_text(text.replace(good, bad), "utf-8")
    assert any(words in fault for fault in router_check.read(changed).faults)


def test_a_key_zenoh_does_not_know_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    changed = tmp_path / "router.json5"
    changed.write_text(json.dumps({"mode": "router", "acces_control": {}}), "utf-8")
    with pytest.raises(BusError, match=r"router.json5: zenoh cannot read it .*acces_control"):
        router_check.read(changed)
    assert main(["config", "check", str(changed)]) == 1
    assert "acces_control" in capsys.readouterr().err


def test_one_machine_is_right_and_a_ward_lacks_only_its_certificates(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "check", str(FILES / "one-machine.json5")]) == 0
    assert "right. A router at tcp/127.0.0.1:7447" in capsys.readouterr().out
    assert main(["config", "check", str(FILES / "ward.json5")]) == 2
    said = capsys.readouterr().err
    assert "/etc/truerate/pki/router.router-3.members.pem: there is no such file or folder" in said
    assert "access_control" not in said


if __name__ == "__main__":
    for name, text in written().items():
        (FILES / f"{name}.json5").write_text(text, "utf-8")

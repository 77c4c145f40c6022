"""The files in configs/zenoh are what `truerate pki router` writes, and `truerate config check` finds their rules right."""

import json
from pathlib import Path

import pytest

from bridge.bus import router_check, router_file
from bridge.bus.contract import BusError
from bridge.pki.certificate_checks import Identity
from bridge.pki.folder import Folder
from bridge.pki.member import Member
from estimator.cli.main import main

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
        "one-machine": "A ward on one machine: no other machine reaches its router, so it asks for no certificate.",
        "ward": (
            "The router of ward-3 on several machines: programs with a certificate get the rights of their role.\n"
            "An example; write your own with: truerate pki router router:router-3 --ward ward-3"
            " --listen tls/0.0.0.0:7447 --at /etc/truerate/pki"
        ),
        "hospital": (
            "A router that joins two wards: it accepts each ward's router for its own ward only.\n"
            "An example; write your own with: truerate pki router router:hospital --ward ward-3 --ward ward-4\n"
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
    ('"enabled": false,\n    "permissions"', '"enabled": true,\n    "permissions"', "adminspace.enabled is true"),
    ('"gossip": {"enabled": false}', '"gossip": {"enabled": true}', "scouting.gossip.enabled is true"),
    ('"gossip": {"enabled": false}', '"gossip": {}', "scouting.gossip.enabled is"),
    ('"mode": "router"', '"mode": "peer"', 'mode is "peer", but "router" is expected'),
    ('"listen_private_key": "/etc/truerate/pki/router.router-3.key",', "", "and listen_private_key are needed"),
    ('"enable_mtls": true', '"enable_mtls": false', "transport.link.tls.enable_mtls is false"),
    ('"close_link_on_expiration": true', '"close_link_on_expiration": false', "close_link_on_expiration is false"),
    ('"default_permission": "deny"', '"default_permission": "allow"', 'access_control.default_permission is "allow"'),
    ("ward-3/raw/bridge-1/*", "ward-3/raw/*/*", "access_control.rules[bridge:bridge-1 says (ward-3)].key_exprs is"),
    ("tls/0.0.0.0:7447", "tcp/0.0.0.0:7447", "every machine in reach can read and command the ward"),
    ('"cert_common_names": ["viewer:hall"]', '"interfaces": ["lo"]', "access_control.subjects[viewer:hall]"),
    ('"permission": "allow"', '"permission": "deny"', '.permission is "deny"'),
    ('"read": false', '"read": true', "adminspace.permissions.read is true"),
    ('"shared_memory": {"enabled": false}', '"shared_memory": {"enabled": true}', "transport.shared_memory.enabled is"),
    ('"mode": "router"', '"mode": "router", "plugins": {"rest": {"http_port": 8000}}', "plugins.rest"),
    ("tls/0.0.0.0:7447", "tls/0.0.0.0:7447#enable_mtls=false", "enable_mtls: overrides the settings for all endpoints"),
    (
        '"size_limit": 65536',
        '"size_limit": 65537',
        "low_pass_filter[size].size_limit is 65537, but 65536 is expected",
    ),
    ('"flows": ["egress"],', "", ".flows is"),
    ('"wait_before_close": 100000', '"wait_before_close": 5000000', "wait_before_close is 5000000"),
    ('"lease": 5000', '"lease": 50', "transport.link.tx.lease is 50"),
    ('"mode": "router"', '"mode": "router", "namespace": "x"', 'namespace is "x"'),
    ('"congestion_control": "drop"', '"congestion_control": "block"', "qos.network"),
    ('"network": [', '"network": [{"messages": ["put"], "overwrite": {"priority": "data_low"}},', "qos.network"),
    ('"tls": {', '"tls": {"root_ca_certificate_base64": "QUJD",', "transport.link.tls.root_ca_certificate_base64 is"),
    (
        '"id": "bridge:bridge-2 says',
        '"id": "bridge:bridge-1 says',
        "access_control.rules: two entries have the same id",
    ),
    ('"cert_common_names": ["viewer:hall"]', '"cert_common_names": ["viewer:*"]', "cert_common_names is"),
]
JOINED = [
    ('"connect_certificate": "/etc/truerate/pki/router.hospital.pem",', "", "connect_certificate is null"),
    ('"verify_name_on_connect": true', '"verify_name_on_connect": false', "verify_name_on_connect is false"),
    ('"timeout_ms": -1', '"timeout_ms": 0', "connect.timeout_ms is 0"),
    ('"tls/ward-3.example:7447"', '"tcp/10.0.0.5:7447"', "the ward's data would travel unencrypted"),
]


@pytest.mark.parametrize(("good", "bad", "words"), BREAKS)
def test_what_was_changed_for_the_worse_is_named(good: str, bad: str, words: str, tmp_path: Path) -> None:
    text = (FILES / "ward.json5").read_text("utf-8")
    assert good in text
    changed = tmp_path / "router.json5"
    changed.write_text(text.replace(good, bad), "utf-8")
    assert any(words in fault for fault in router_check.read(changed).faults)


@pytest.mark.parametrize(("good", "bad", "words"), JOINED)
def test_so_it_is_of_a_router_that_joins_others(good: str, bad: str, words: str, tmp_path: Path) -> None:
    text = (FILES / "hospital.json5").read_text("utf-8")
    assert good in text
    changed = tmp_path / "router.json5"
    changed.write_text(text.replace(good, bad, 1), "utf-8")
    assert any(words in fault for fault in router_check.read(changed).faults)


def test_a_second_policy_gives_nobody_anothers_rights(tmp_path: Path) -> None:
    settings = router_file.guarded(LISTEN, identity("router:r"), [("w", Member.parse(who)) for who in WARD])
    policies = settings["access_control"]["policies"]
    desk = next(policy for policy in policies if policy["subjects"] == ["commander:desk"])
    policies.insert(0, {"rules": desk["rules"], "subjects": ["viewer:hall"]})
    changed = tmp_path / "router.json5"
    changed.write_text(json.dumps(settings), "utf-8")
    assert any("access_control.policies: two entries" in fault for fault in router_check.read(changed).faults)


def test_a_key_zenoh_does_not_know_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    changed = tmp_path / "router.json5"
    changed.write_text(json.dumps({"mode": "router", "acces_control": {}}), "utf-8")
    with pytest.raises(BusError, match=r"line 1: unknown key 'acces_control'; did you mean 'access_control'\?"):
        router_check.read(changed)
    assert main(["config", "check", str(changed)]) == 2
    assert "acces_control" in capsys.readouterr().err
    assert main(["config", "check", str(tmp_path / "none.json5")]) == 2
    assert "none.json5: there is no such file\n" in capsys.readouterr().err


def test_one_machine_is_right_and_a_ward_lacks_only_its_certificates(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "check", str(FILES / "one-machine.json5")]) == 0
    assert "valid. Router at tcp/127.0.0.1:7447" in capsys.readouterr().out
    assert main(["config", "check", str(FILES / "ward.json5")]) == 2
    said = capsys.readouterr().err
    assert "/etc/truerate/pki/router.router-3.members.pem: there is no such file or folder" in said
    assert "access_control" not in said


if __name__ == "__main__":
    for name, text in written().items():
        (FILES / f"{name}.json5").write_text(text, "utf-8")

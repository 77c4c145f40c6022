"""`truerate bridge`: what it says, teaches and refuses."""

import argparse
from pathlib import Path
from typing import Any

import pytest

from bridge.cli import bridge, router
from bridge.sim.pty_port import PtyPort
from bridge.sim.virtual_device import demo_device
from estimator.cli.main import main


def parsed(*arguments: str) -> Any:
    parser = argparse.ArgumentParser()
    verbs = parser.add_subparsers(required=True)
    bridge.add_verbs(verbs)
    router.add_verbs(verbs)
    return parser.parse_args(arguments)


def test_list_says_which_devices_are_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "w.toml"
    with PtyPort(demo_device("d1", 1), tmp_path / "d1") as port:
        config.write_text(
            'ward = "w"\n[bridge]\nid = "b"\n'
            f'[[bridge.devices]]\nid = "here"\ndriver = "native"\nport = "{port.link}"\n'
            f'[[bridge.devices]]\nid = "gone"\ndriver = "native"\nport = "{tmp_path}/gone"\n'
        )
        args = parsed("bridge", "list", str(config))
        assert args.run(args) == 0
    shown = capsys.readouterr().out
    assert "simulated" in shown
    assert f"{port.link}: present" in shown
    assert f"{tmp_path}/gone is missing" in shown


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("bridge", "run", "none.toml"), 2, "truerate: none.toml: there is no such file; give the path of a TOML file"),
        (("bridge", "replay", "none.npz", "--device", "d"), 1, "truerate: none.npz: there is no such file"),
        (("bridge", "replay", "none.npz", "--device", "d", "--ward", "W W"), 2, "truerate: ward 'W W' is not valid"),
        (("router", "--listen", "here"), 2, "truerate: --listen: 'here' is not an endpoint"),
        (
            ("bridge", "replay", "none.npz", "--device", "d", "--connect", "foo"),
            2,
            "truerate: --connect: 'foo' is not an endpoint: write PROTOCOL/HOST:PORT, such as 'tcp/127.0.0.1:7447'\n",
        ),
    ],
)
def test_wrong_use_is_one_line_and_an_exit_code(
    arguments: tuple[str, ...], code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(list(arguments)) == code
    error = capsys.readouterr().err
    assert error.startswith(said)
    assert error.count("\n") == 1

"""The command line as people use it: what it prints, what it says of mistakes, and its exit codes."""

import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from estimator.cli.main import main

ROOT = Path(__file__).parents[3]
DEMO = ROOT / "configs" / "demo.toml"


def test_a_store_that_is_a_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "ward.toml"
    config.write_text(f'ward = "w"\n[estimator]\nid = "e"\nstore = "{tmp_path}"\n')
    for verb in (["config", "check"], ["estimator", "serve"]):
        assert main([*verb, str(config)]) == 2
        assert f"store is '{tmp_path}', which is a folder" in capsys.readouterr().err


@pytest.mark.parametrize(("text", "said"), [("", "give a text"), (" \t", "give a text"), ("x" * 501, "at most 500")])
def test_a_note_that_says_nothing_or_too_much_is_refused_at_once(
    text: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["note", "chest", text]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("words", [["status"], ["recalibrate", "chest"]])
def test_without_a_router_one_line_says_what_to_do(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*words, "--connect", "tcp/127.0.0.1:1"]) == 1
    *before, said = capsys.readouterr().err.splitlines()
    assert "truerate router --listen tcp/127.0.0.1:1" in said
    assert [line for line in before if not line.startswith("listening to ward ward")] == []


@pytest.mark.parametrize("name", ["demo.toml", "ward.toml"])
def test_shipped_configurations_are_right(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "check", str(ROOT / "configs" / name)]) == 0
    assert "valid" in capsys.readouterr().out


def test_a_store_in_a_folder_that_is_not_there_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "ward.toml"
    for folder, named in ((tmp_path, False), (tmp_path / "none", True)):
        path.write_text(f'ward = "w"\n[estimator]\nid = "e"\nstore = "{folder}/a.sqlite3"\n', "utf-8")
        assert main(["config", "check", str(path)]) == 0, "the estimator creates"
        assert (f"the folder {folder} does not exist" in capsys.readouterr().out) == named


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("store =", "stor ="), ["[estimator]", "'stor'", "'store'"]),
        (('"out/demo.sqlite3"', '""'), ["[estimator]", "store is ''", "the path of a file"]),
        (("batch_ms", "batch_mss"), ["[bridge]", "'batch_mss'", "'batch_ms'"]),
        (('driver = "simulated"', 'driver = "simulate"'), ["#1", "'simulate'", "'simulated'"]),
        (('id = "chest"', 'id = "che/st"'), ["#1", "che/st", "not valid"]),
        (('id = "estimator-1"', 'id = "estimator-1"\nmethod = "turn36"'), ["'turn36'", "'turn360'"]),
    ],
)
def test_a_wrong_configuration_names_file_table_key_and_the_nearest_name(
    change: tuple[str, str], words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (ROOT / "configs" / "demo.toml").read_text(encoding="utf-8")
    assert change[0] in text
    path = tmp_path / "wrong.toml"
    path.write_text(text.replace(*change, 1), encoding="utf-8")
    assert main(["config", "check", str(path)]) == 2
    said = capsys.readouterr().err
    assert "wrong.toml" in said
    for word in words:
        assert word in said


WARD, DEVICE = (
    'ward = "w"\n',
    '[bridge]\nid = "b"\ndevices = [{ id = "chest", driver = "native", port = "/dev/none" }]\n',
)
MODELS = '[estimator]\nid = "e"\nmodels = { chst = "lsm9ds1", chest = "lsm9ds1" }\n'


@pytest.mark.parametrize(
    ("ward", "bridges", "said"),
    [
        (
            WARD + '[devices]\nenrolled = ["b/chest", "wrist"]\n',
            "",
            "'chst' is neither enrolled nor a device of these files",
        ),
        (
            WARD + DEVICE,
            "",
            "'chst' is neither enrolled nor a device of these files",
        ),
        (
            WARD,
            WARD + DEVICE,
            "'chst' is neither enrolled nor a device of these files",
        ),
        (WARD, 'ward = "another"\n' + DEVICE, ""),
        (WARD, "", ""),
    ],
)
def test_a_model_of_a_device_that_is_not_there_is_noted(
    ward: str, bridges: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = {tmp_path / "ward.toml": ward + MODELS, tmp_path / "bridge.toml": bridges}
    for file, text in files.items():
        file.write_text(text, encoding="utf-8")
    assert main(["config", "check", *(str(file) for file, text in files.items() if text)]) == 0
    printed = capsys.readouterr().out
    if said:
        assert f"ward.toml: [estimator]: models: {said}; did you mean 'chest'?\n" in printed
    assert printed.count("models") == bool(said)


def test_a_file_without_an_estimator_cannot_be_served(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "none.toml"
    path.write_text('ward = "w"\n', encoding="utf-8")
    assert main(["estimator", "serve", str(path)]) == 2
    assert "[estimator]" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["calibrate", "a.npz", "--metod", "turn360"],
            "truerate calibrate: unknown option '--metod'; did you mean '--method'?",
        ),
        (["bridge", "run", "a.toml", "--cofig=x"], "truerate bridge run: unknown option '--cofig'; "),
        (["calibrate", "a.npz", "b.npz"], "truerate calibrate: unexpected 'b.npz'"),
        (["demo", "--seed", "-1"], "'-1': use a whole number from 0 to"),
    ],
)
def test_what_no_verb_takes_is_refused_in_a_line(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    told = capsys.readouterr().err
    assert (ended.value.code, told.count("\n")) == (2, 1)
    assert said in told


def test_the_version_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert (ended.value.code, capsys.readouterr().out) == (0, f"truerate {version('truerate')}\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no disk here that is always full")
@pytest.mark.parametrize(
    ("words", "unbuffered"), [(["--version"], ""), (["config", "check", str(DEMO)], "1"), (["allan", "--help"], "1")]
)
def test_what_goes_to_a_full_disk_fails_in_our_words(words: list[str], unbuffered: str) -> None:
    program = "import sys; from estimator.cli.entry import main; sys.exit(main())"
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            [sys.executable, "-c", program, *words],
            stdout=full, stderr=subprocess.PIPE, text=True, check=False, timeout=60,
            env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
        )  # fmt: skip
    told = not (unbuffered and "--help" in words)  # argparse itself says nothing then
    assert (ended.returncode, ended.stderr) == ((1, "truerate: the disk is full\n") if told else (0, ""))


def test_who_reads_no_further_ends_it_without_a_word() -> None:
    program = "import sys; from estimator.cli.entry import main; sys.exit(main())"
    with subprocess.Popen(
        [sys.executable, "-c", program, "config", "check", str(DEMO)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as ended:
        assert ended.stdout is not None
        ended.stdout.close()
        assert (ended.wait(60), ended.stderr.read() if ended.stderr else b"") == (1, b"")


def test_a_study_of_the_paper_needs_a_scenario_it_can_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shipped = (Path(__file__).parents[3] / "configs" / "study" / "errors.toml").read_text(encoding="utf-8")
    own = tmp_path / "own.toml"
    for text, said in (
        (shipped + "\nnoise = 1\n", "unknown key 'noise'; did you mean 'noise_dps'?"),
        (shipped.replace("runs = 15000", "runs = 0"), "runs is 0; allowed: 1 or more"),
        (shipped.replace("[5.5e-3, 2.5e-2]", "[5.5e-3]"), "paper_band has 1 numbers, but noise_dps has 2"),
    ):
        own.write_text(text, encoding="utf-8")
        assert main(["study", "errors", "--config", str(own), "--out", str(tmp_path)]) == 2
        assert said in capsys.readouterr().err
    assert main(["study", "errors", "--config", "eror", "--out", str(tmp_path)]) == 2
    assert "unknown study 'eror'; did you mean 'errors'?" in capsys.readouterr().err
    assert main(["study", "real", "--out", str(tmp_path)]) == 2
    assert "give the file with --recording FILE" in capsys.readouterr().err


def test_where_no_picture_can_be_is_said_before_the_work(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "file").touch()
    (tmp_path / "thesis.pdf").write_bytes(b"%PDF-1.7 my only copy")
    for place, said in (
        ("thesis.pdf", "the file exists and truerate did not draw it; give another name, or remove the file"),
        ("out.xyz", "unknown file type '.xyz'; use .png, .svg, .pdf"),
        ("folder.png", "is a folder; give a file name"),
        ("file/out.png", "is not a folder; give another path"),
    ):
        assert main(["demo", "--picture", str(tmp_path / place)]) == 2
        assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    "where",
    [
        "sys.meta_path.insert(0, type('', (), {'find_spec': lambda name, *_: now() if name == 'estimator.cli.main' else None}))",
        "import argparse; argparse.ArgumentParser.__init__ = lambda *_, **__: now()",
        "import bridge.runtime.logs; bridge.runtime.logs.configure_logging = lambda *_: now()",
    ],
)
def test_who_interrupts_outside_of_the_work_gets_no_traceback(where: str) -> None:
    interrupted = f"""import os, signal, sys
def now(*_):
    os.kill(os.getpid(), signal.SIGINT)
{where}
from estimator.cli.entry import main
sys.argv[1:] = ["config", "check", {str(DEMO)!r}]
sys.exit(main())"""
    ended = subprocess.run([sys.executable, "-c", interrupted], capture_output=True, text=True, timeout=60, check=False)
    assert (ended.returncode, ended.stderr) == (130, "")


@pytest.mark.parametrize("megabytes", [50, 150, 250])
def test_too_little_memory_is_one_sentence(megabytes: int, tmp_path: Path) -> None:
    """Loading a library or computing: whatever did not fit, no traceback."""
    command = f"ulimit -v {megabytes * 1024}; exec {sys.executable} -m estimator.cli.main calibrate {tmp_path}/none.npz"
    done = subprocess.run(
        ["bash", "-c", command],
        capture_output=True,
        text=True,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        check=False,
    )
    assert done.returncode == 1 or "none.npz" in done.stderr
    assert "Traceback" not in done.stderr

"""Builds a release into dist/: wheel, sdist, and for each platform a Debian package and a bundle that installs without a network.

`make release`. Needs Debian bookworm's Python 3.11, for which the environment in /opt/truerate is made. Equal sources and pins
give equal files: times are those of the commit.
"""

import gzip
import hashlib
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
from email.utils import formatdate
from pathlib import Path

import shtab
from packaging.utils import canonicalize_name

from estimator.cli.main import build

ROOT = Path(__file__).parent.parent
PACKAGING = ROOT / "packaging"
DIST = ROOT / "dist"
PYTHON, PYTHON_VERSION = "/usr/bin/python3.11", "3.11"
#: Debian's names of the platforms
PLATFORMS = {"x86_64": "amd64", "aarch64": "arm64"}
#: as in nfpm.yaml
MAINTAINER = "truerate maintainers <maintainers@localhost>"
#: extras to read recordings of other tools; the bundle contains them, the Debian package does not
ANALYSIS = ("cwa", "hdf5", "parquet", "xdf")
#: packages whose tests (60 MB) the Debian package leaves out, as SciPy's manual allows ("Building redistributable binaries")
OPTIONAL_TESTS = ("matplotlib", "mpl_toolkits", "numpy", "scipy")
#: packages published as source only; built without a compiler, they are pure Python and fit every platform
SOURCES = ("cobs",)


def main() -> None:
    """Build everything, or only the platforms named as arguments."""
    os.environ["SOURCE_DATE_EPOCH"] = _output("git", "-C", str(ROOT), "log", "-1", "--format=%ct")
    shutil.rmtree(DIST, ignore_errors=True)
    _run("uv", "build", "-q", "--out-dir", str(DIST), str(ROOT))
    (DIST / ".gitignore").unlink(missing_ok=True)
    wheel = next(DIST.glob("*.whl"))
    version = wheel.name.split("-")[1]
    for platform in sys.argv[1:] or PLATFORMS:
        with tempfile.TemporaryDirectory() as folder:
            work = Path(folder)
            print(f"{platform}: wheels", flush=True)
            wheels = _wheels(work, platform, wheel)
            print(f"{platform}: bundle", flush=True)
            _bundle(work, wheels, f"truerate-{version}-linux-{platform}")
            print(f"{platform}: Debian package", flush=True)
            _debian(work, wheels, platform, version)
    sums = [f"{_sha256(path)}  {path.name}" for path in sorted(DIST.iterdir())]
    (DIST / "SHA256SUMS").write_text("\n".join(sums) + "\n")
    for path in sorted(DIST.iterdir()):
        print(f"{path.stat().st_size / 1e6:8.1f} MB  dist/{path.name}")


def _wheels(work: Path, platform: str, wheel: Path) -> Path:
    """Download the pinned wheels of a platform, checked by their hashes; returns their folder."""
    wheels, pins = work / "wheels", work / "pins.txt"
    left_out = [word for name in SOURCES for word in ("--no-emit-package", name)]
    _run(
        *("uv", "pip", "compile", "-q", "--generate-hashes", "--no-annotate", "--no-header", *left_out),
        *("--python-platform", f"{platform}-manylinux_2_28", "--python-version", PYTHON_VERSION),
        *("-o", str(pins), str(ROOT / "requirements/deploy.txt")),
    )
    tags = [f"manylinux_2_{minor}_{platform}" for minor in range(28, 16, -1)] + [f"manylinux2014_{platform}"]
    _run(
        *("pip", "download", "-q", "--no-deps", "--require-hashes", "--only-binary", ":all:", "-d", str(wheels)),
        *("--python-version", PYTHON_VERSION, "--implementation", "cp", *(f"--platform={tag}" for tag in tags)),
        *("-r", str(pins)),
    )
    pinned = (ROOT / "requirements/deploy.txt").read_text().splitlines()
    for name in SOURCES:
        first = next(at for at, line in enumerate(pinned) if line.startswith(f"{name}=="))
        entry = [pinned[first], *(line for line in pinned[first + 1 : first + 9] if line.startswith(" "))]
        source = work / "source.txt"
        source.write_text("\n".join(entry[: 1 + sum(line.endswith("\\") for line in entry)]) + "\n")
        _run(
            *("pip", "wheel", "-q", "--no-cache-dir", "--no-deps", "--require-hashes", "-w", str(wheels)),
            *("-r", str(source)),
            env={"CC": "/bin/false"},
        )
    shutil.copy(wheel, wheels)
    return wheels


def _needed(work: Path, platform: str) -> set[str]:
    """Names of the packages that a ward's machine needs."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    pins = work / "needed.txt"
    _run(
        *("uv", "pip", "compile", "-q", "--no-annotate", "--no-header", "-o", str(pins)),
        *("--python-platform", f"{platform}-manylinux_2_28", "--python-version", PYTHON_VERSION),
        *(word for name in extras if name not in ANALYSIS for word in ("--extra", name)),
        *("--constraint", str(ROOT / "requirements/deploy.txt"), str(ROOT / "pyproject.toml")),
    )
    return {"truerate", *(canonicalize_name(line.partition("==")[0]) for line in pins.read_text().splitlines())}


def _bundle(work: Path, wheels: Path, name: str) -> None:
    """Pack wheels, checksums and the script that installs them into one archive."""
    root = work / name
    shutil.copytree(wheels, root / "wheels")
    pins = [
        f"{wheel.name.split('-')[0]}=={wheel.name.split('-')[1]} --hash=sha256:{_sha256(wheel)}"
        for wheel in sorted(wheels.iterdir())
    ]
    (root / "requirements.txt").write_text("\n".join(pins) + "\n")
    for what in ("configs", "docs", "README.md", "LICENSE", "SECURITY.md", "CHANGELOG.md"):
        copy = shutil.copytree if (ROOT / what).is_dir() else shutil.copy
        copy(ROOT / what, root / what)
    shutil.copytree(PACKAGING / "systemd", root / "systemd")
    shutil.copy(PACKAGING / "install.sh", root)
    files = sorted(path for path in root.rglob("*") if path.is_file() and path.name != "SHA256SUMS")
    (root / "SHA256SUMS").write_text("".join(f"{_sha256(path)}  {path.relative_to(root)}\n" for path in files))
    when = int(os.environ["SOURCE_DATE_EPOCH"])

    def plain(info: tarfile.TarInfo) -> tarfile.TarInfo:
        info.uid = info.gid = 0
        info.uname = info.gname = "root"
        info.mtime = when
        return info

    with (
        (DIST / f"{name}.tar.gz").open("wb") as raw,
        gzip.GzipFile("", "wb", 1, raw, mtime=when) as packed,
        tarfile.open(fileobj=packed, mode="w") as archive,
    ):
        for path in [root, *sorted(root.rglob("*"))]:
            archive.add(path, str(path.relative_to(work)), recursive=False, filter=plain)


def _debian(work: Path, wheels: Path, platform: str, version: str) -> None:
    """Install the wheels into an environment for /opt/truerate, add documentation, and build the package."""
    tree = work / "tree"
    environment, share = tree / "opt/truerate", tree / "usr/share"
    there = ("--python", f"{environment}/bin/python", "--python-platform", f"{platform}-manylinux_2_28")
    needed = _needed(work, platform)
    chosen = [str(one) for one in sorted(wheels.iterdir()) if canonicalize_name(one.name.split("-")[0]) in needed]
    _run("uv", "venv", "-q", "--relocatable", "--python", PYTHON, str(environment))
    _run("uv", "pip", "install", "-q", "--no-index", "--no-deps", "--link-mode", "copy", *there, *chosen)
    # A dependency without a pin would be missing in every installation.
    _run("uv", "pip", "check", "-q", *there)
    for path in (environment / "bin").iterdir():
        if path.name != "truerate" and not path.name.startswith("python"):
            path.unlink()
    for library in OPTIONAL_TESTS:
        for folder in list((environment / f"lib/python{PYTHON_VERSION}/site-packages" / library).rglob("tests")):
            shutil.rmtree(folder)
    for path in environment.rglob("*"):
        if path.name in {"direct_url.json", "uv_cache.json", "REQUESTED", ".gitignore", ".lock"}:
            path.unlink()
    _run(
        PYTHON,
        "-m",
        "compileall",
        "-q",
        "--invalidation-mode",
        "unchecked-hash",
        "-s",
        str(tree),
        str(environment),
        check=False,
    )
    _documents(share, version)
    environ = {"ARCH": PLATFORMS[platform], "VERSION": version, "TREE": str(tree)}
    nfpm = work / "nfpm.yaml"
    text = (PACKAGING / "nfpm.yaml").read_text()
    for name, value in environ.items():
        text = text.replace(f"${{{name}}}", value)
    nfpm.write_text(text)
    _run("nfpm", "package", "--config", str(nfpm), "--packager", "deb", "--target", str(DIST))


def _documents(share: Path, version: str) -> None:
    """Write manual page, shell completion, copyright, changelog and example ward files below usr/share."""
    docs = share / "doc/truerate"
    docs.mkdir(parents=True)
    shutil.copy(ROOT / "LICENSE", docs / "copyright")
    shutil.copy(ROOT / "CHANGELOG.md", docs)
    when = formatdate(int(os.environ["SOURCE_DATE_EPOCH"]))
    entry = f"truerate ({version}) stable; urgency=medium\n\n  * See CHANGELOG.md.\n\n -- {MAINTAINER}  {when}\n"
    (docs / "changelog.gz").write_bytes(gzip.compress(entry.encode(), 9, mtime=0))
    shutil.copytree(ROOT / "configs", docs / "examples")
    shutil.copy(ROOT / "docs/install.md", docs)
    parser = build()
    for shell, path in (("bash", "bash-completion/completions/truerate"), ("zsh", "zsh/vendor-completions/_truerate")):
        (share / path).parent.mkdir(parents=True)
        (share / path).write_text(shtab.complete(parser, shell))
    pages = share / "man/man1"
    pages.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as out:
        _run(
            "sphinx-build",
            "-q",
            "-b",
            "man",
            "-D",
            "nb_execution_mode=off",
            "-D",
            f"release={version}",
            str(ROOT / "docs"),
            out,
        )
        (pages / "truerate.1.gz").write_bytes(gzip.compress(Path(out, "truerate.1").read_bytes(), 9, mtime=0))


def _run(program: str, *words: str, env: dict[str, str] | None = None, check: bool = True) -> None:
    beside = Path(sys.executable).parent / program
    subprocess.run(
        [str(beside) if beside.exists() else program, *words], check=check, env={**os.environ, **(env or {})}, cwd=ROOT
    )


def _output(*words: str) -> str:
    return subprocess.run(words, check=True, capture_output=True, text=True).stdout.strip()


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


if __name__ == "__main__":
    main()

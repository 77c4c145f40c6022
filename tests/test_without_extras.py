"""An installation without the optional extras: all modules load, except those that serve one driver, format or outlet."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: rooms of which each module may need the library of its own device, file format or kind of subscriber
ON_REQUEST = ("bridge.drivers.", "bridge.recording.formats.", "estimator.outlets.")
PROGRAM = """
import importlib, pkgutil, sys
from importlib.metadata import packages_distributions, requires, PackageNotFoundError
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

plain, to_see = set(), ["truerate"]
while to_see:
    name = canonicalize_name(to_see.pop())
    if name in plain:
        continue
    plain.add(name)
    try:
        needed = [Requirement(one) for one in requires(name) or ()]
    except PackageNotFoundError:
        continue
    to_see += [one.name for one in needed if one.marker is None or one.marker.evaluate({"extra": ""})]
for module, packages in packages_distributions().items():
    if not plain & {canonicalize_name(package) for package in packages}:
        sys.modules[module] = None  # as if it were not installed

import bridge, estimator
for package in bridge, estimator:
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if not module.name.endswith("__main__"):
            try:
                importlib.import_module(module.name)
            except ModuleNotFoundError as error:
                print(module.name, error.name)
"""


def test_only_what_an_extra_is_for_needs_it() -> None:
    ran = subprocess.run([sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    failed = dict(line.split() for line in ran.stdout.splitlines())
    assert {module: missing for module, missing in failed.items() if not module.startswith(ON_REQUEST)} == {}
    assert failed["bridge.recording.formats.hdf5"] == "h5py"  # it was as if extras were missing

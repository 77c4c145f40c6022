"""An installation without the optional extras: all modules load, except those that serve one driver, format or outlet."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: rooms of which each module may need the library of its own device, file format or kind of subscriber
ON_REQUEST = ("bridge.drivers.", "bridge.recording.formats.", "estimator.outlets.")
PROGRAM = '''
import importlib, pkgutil, sys
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, metadata, packages_distributions, requires
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name



def needed(extras):
    """Names of the packages that truerate needs with these extras, and that those need."""
    found, to_see = set(), [Requirement(f"truerate[{','.join(extras)}]")]
    while to_see:
        one = to_see.pop()
        if (name := canonicalize_name(one.name), *sorted(one.extras)) not in found:
            found.add((name, *sorted(one.extras)))
            with suppress(PackageNotFoundError):
                for part in map(Requirement, requires(name) or ()):
                    if part.marker is None or any(part.marker.evaluate({"extra": e}) for e in ("", *one.extras)):
                        to_see.append(part)
    return {name for name, *_ in found}


of_extras = needed(metadata("truerate").get_all("Provides-Extra")) - needed([])
for module, packages in packages_distributions().items():
    if of_extras >= {canonicalize_name(package) for package in packages}:
        sys.modules[module] = None  # as if it were not installed

import bridge, estimator
for package in bridge, estimator:
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if not module.name.endswith("__main__"):
            try:
                importlib.import_module(module.name)
            except ModuleNotFoundError as error:
                print(module.name, error.name)
'''


def test_only_what_an_extra_is_for_needs_it() -> None:
    ran = subprocess.run([sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    failed = dict(line.split() for line in ran.stdout.splitlines())
    assert {module: missing for module, missing in failed.items() if not module.startswith(ON_REQUEST)} == {}
    assert failed["bridge.recording.formats.hdf5"] == "h5py"  # it was as if extras were missing

"""No library's private parts: any release of it may change them."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
#: calls and imports that reach behind a public interface, by how they are written
FORBIDDEN = ("os._exit", "gc.freeze", "sys.modules", "uvicorn.protocols", "ctypes", "numba.core", "_signal")
#: documented names of NamedTuple and Enum
PUBLIC = {"_asdict", "_replace", "_fields", "_make", "_value_"}
#: what is still to go, by file
KNOWN = {
    "bridge/diagnose/machine.py": {"ctypes"},  # adjtimex is in no Python library
    "estimator/web/listener.py": {"uvicorn.protocols"},
}


def files() -> dict[str, ast.Module]:
    found = (path for root in ("bridge", "estimator") for path in (ROOT / root).rglob("*.py"))
    return {
        path.relative_to(ROOT).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
        for path in found
        if not path.stem.endswith("_pb2")
    }


def own(tree: ast.Module) -> Iterator[str]:
    """Names that a file gives to something of its own."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store) and _of_self(node):
            yield node.attr


def _of_self(node: ast.Attribute) -> bool:
    return isinstance(node.value, ast.Name) and node.value.id in ("self", "cls", "fresh", "anew")


def reaches(tree: ast.Module, ours: set[str]) -> set[str]:
    """What a file uses of others that is not for it."""
    found = set[str]()
    for node in ast.walk(tree):
        names = list[str]()
        if isinstance(node, ast.Attribute):
            names = [ast.unparse(node)]
            if node.attr.startswith("_") and not node.attr.startswith("__") and node.attr not in ours | PUBLIC:
                found.add(names[0])
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names = [node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)]
        found |= {wrong for wrong in FORBIDDEN for name in names if name == wrong or name.startswith(f"{wrong}.")}
    return found


TREES = files()
OURS = {name for tree in TREES.values() for name in own(tree)}


@pytest.mark.parametrize(
    "wrong", ["kf._alpha_sq = 1", "import ctypes", "from numba.core import caching", "os._exit(0)"]
)
def test_what_is_private_is_seen(wrong: str) -> None:
    assert reaches(ast.parse(wrong), OURS)


def test_nothing_private_of_a_library_is_used() -> None:
    found = {name: wrong for name, tree in TREES.items() if (wrong := reaches(tree, OURS))}
    assert found == KNOWN

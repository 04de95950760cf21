"""The engine needs NumPy, Warp and the kernels: no file, viewer, mesher or command line."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

import warp_trunk.engine

ENGINE = Path(warp_trunk.engine.__path__[0])
KERNELS = Path(importlib.import_module("warp_trunk.kernels").__path__[0])
ALLOWED = ("numpy", "warp", "warp_trunk.kernels", "warp_trunk.errors", "warp_trunk.engine")


def modules() -> list[tuple[str, Path]]:
    """Every module of the engine and of the kernels, with its file."""
    return [
        (".".join([package, *path.relative_to(folder).with_suffix("").parts]), path)
        for package, folder in (("warp_trunk.engine", ENGINE), ("warp_trunk.kernels", KERNELS))
        for path in sorted(folder.rglob("*.py"))
    ]


def foreign(name: str, source: str) -> list[str]:
    """Forbidden imports of a module, at its top, inside a function or for type checkers."""
    package = name.rpartition(".")[0]
    imported: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            imported += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = importlib.util.resolve_name("." * node.level + (node.module or ""), package)
            imported += [base] if node.module else [f"{base}.{alias.name}" for alias in node.names]
    return [
        each
        for each in imported
        if each.split(".")[0] not in sys.stdlib_module_names
        and not any(each == one or each.startswith(f"{one}.") for one in ALLOWED)
    ]


@pytest.mark.parametrize(("name", "path"), modules(), ids=lambda value: value if isinstance(value, str) else "")
def test_imports_nothing_else(name: str, path: Path) -> None:
    assert foreign(name, path.read_text()) == []


@pytest.mark.parametrize(
    "source",
    [
        "import scipy.sparse",
        "from warp_trunk.bone_motion.bone_path import BonePath",
        "from warp_trunk import read_case",
        "from ...geometry import spline",
        "from ... import io",
        "def f():\n    import meshio",
        "if TYPE_CHECKING:\n    from ...case import Case",
    ],
)
def test_another_import_is_found(source: str) -> None:
    assert foreign("warp_trunk.engine.relaxation.loop", source)


def test_runs_where_only_numpy_and_warp_are_installed() -> None:
    """Every other package is refused, as if it were not there, but what finds the public names of warp_trunk."""
    code = f"""
import importlib, sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        top = name.split(".")[0]
        if top not in sys.stdlib_module_names and top not in ("numpy", "warp", "warp_trunk", "lazy_loader"):
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Refuse())
for name in {[name.removesuffix(".__init__") for name, _ in modules()]}:
    importlib.import_module(name)
print(sorted(name for name in sys.modules if name.startswith("warp_trunk.") and name.count(".") == 1))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "['warp_trunk.engine', 'warp_trunk.errors', 'warp_trunk.kernels']"

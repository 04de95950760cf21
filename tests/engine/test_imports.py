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
ALLOWED = (
    "numpy", "warp", "warp_trunk.kernels", "warp_trunk.errors", "warp_trunk.system", "warp_trunk.checking",
    "warp_trunk.engine",
)  # fmt: skip


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
        and not any(each == module or each.startswith(f"{module}.") for module in ALLOWED)
    ]


def test_engine_and_kernels_import_nothing_else() -> None:
    for package, folder in (("warp_trunk.engine", ENGINE), ("warp_trunk.kernels", KERNELS)):
        for path in folder.rglob("*.py"):
            name = ".".join([package, *path.relative_to(folder).with_suffix("").parts])
            assert foreign(name, path.read_text(encoding="utf-8")) == [], name


@pytest.mark.parametrize(
    "source", ["import trimesh", "from ... import io", "def f():\n    from warp_trunk.case import Case"]
)
def test_another_import_is_found(source: str) -> None:
    assert foreign("warp_trunk.engine.relaxation.loop", source)


def test_decisions_need_no_device() -> None:
    """Nor Warp: `policy` and what it imports are tested and read without one."""
    code = "import sys; import warp_trunk.engine.policy; sys.exit('warp' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

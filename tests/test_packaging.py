"""Imports of the package: importing it is cheap, and nothing imports what imports it."""

import ast
import importlib
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import check_imports

import warp_trunk

ROOT = Path(warp_trunk.__file__).parent
KERNELS = Path(importlib.import_module("warp_trunk.kernels").__path__[0])
HEAVY = ["rerun", "tetgen", "trimesh", "warp", "meshio", "scipy", "tyro", "rich", "matplotlib", "jinja2"]


def python(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_importing_the_package_imports_nothing_heavy():
    assert python(f"import sys, warp_trunk; print([m for m in {HEAVY} if m in sys.modules])") == "[]"


def test_importing_the_package_and_all_its_names_starts_no_cuda():
    """Workers of a cohort get their GPU after that; Warp may be loaded, but not initialised."""
    code = """
import sys, warp_trunk
for name in warp_trunk.__all__:
    getattr(warp_trunk, name)
import warp_trunk.cohort.working
warp = sys.modules["warp"]
assert warp._src.context.runtime is None, "Warp is initialised"
libraries = open("/proc/self/maps").read() if sys.platform == "linux" else ""
print([line for line in libraries.splitlines() if "libcuda.so" in line])
"""
    assert python(code) == "[]"


def test_bare_kernels_cannot_be_imported_outside_the_checkout(tmp_path):
    """A package called kernels exists on the package index; ruff refuses the bare name."""
    done = subprocess.run(
        [sys.executable, "-c", "import kernels"], cwd=tmp_path, capture_output=True, encoding="utf-8"
    )
    assert "ModuleNotFoundError" in done.stderr


def test_every_public_name_is_there():
    """The stub is what `__init__` imports from and what type checkers read."""
    tree = ast.parse((ROOT / "__init__.pyi").read_text(encoding="utf-8"))
    listed = next(ast.literal_eval(node.value) for node in tree.body if isinstance(node, ast.Assign))
    assert sorted(listed) == listed == sorted(warp_trunk.__all__)
    for name in listed:
        assert getattr(warp_trunk, name).__name__ == name
    assert set(listed) <= set(dir(warp_trunk))


def test_no_public_name_is_also_a_module():
    """Importing such a module would put it in the place of the name."""
    for room in [ROOT, *(path.parent for path in ROOT.glob("*/__init__.py"))]:
        name = ".".join(["warp_trunk", *room.relative_to(ROOT).parts])
        public = getattr(importlib.import_module(name), "__all__", [])
        assert not set(public) & {path.stem for path in room.iterdir()}, name


def test_every_other_file_is_listed_for_the_wheel():
    """setuptools leaves out what is neither Python nor listed."""
    listed = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["tool"][
        "setuptools"
    ]["package-data"]
    no_source = {".py", ".pyc"}
    other_files = {path for path in ROOT.rglob("*") if path.is_file() and path.suffix not in no_source}
    assert other_files == {ROOT.parent / room.replace(".", "/") / name for room in listed for name in listed[room]}


def test_imports_keep_to_the_order_of_packages():
    done = check_imports.check()
    assert done.returncode == 0, done.stdout


def test_an_import_against_the_order_is_found(tmp_path):
    for part in ("warp_trunk", "kernels", "pyproject.toml"):
        (tmp_path / part).symlink_to(check_imports.ROOT / part)
    (tmp_path / "kernels").unlink()
    shutil.copytree(KERNELS, tmp_path / "kernels", ignore=shutil.ignore_patterns("__pycache__"))
    with (tmp_path / "kernels" / "vectors.py").open("a", encoding="utf-8") as file:
        file.write("import warp_trunk.engine.model\n")
    assert "warp_trunk.kernels is not allowed to import warp_trunk.engine" in check_imports.check(tmp_path).stdout


def test_every_package_states_what_it_may_import():
    """The row below it in the contracts of import-linter; a package inside another also what that one may."""
    text, words = (ROOT.parent / "pyproject.toml").read_text(encoding="utf-8"), {}
    for contract in tomllib.loads(text)["tool"]["importlinter"]["contracts"]:
        rows = [row.split(" | ") for row in contract.get("layers", ())]
        for number, row in enumerate(rows, start=1):
            names = [f"`{name}`" for name in (rows[number] if number < len(rows) else ())]
            lower = f"{', '.join(names)} and below" if number < len(rows) - 1 else " and ".join(names)
            words |= {f"{contract['containers'][0]}.{name}": lower for name in row}
    inner = {".".join(path.parent.relative_to(ROOT.parent).parts) for path in ROOT.glob("*/**/__init__.py")}
    assert {"warp_trunk.case", "warp_trunk.kernels", "warp_trunk.io.surface_files"} <= inner | words.keys()
    for name in inner | words.keys():
        _, *own, _ = name.split(".")
        parts = [words.get(name, ""), *(f"what `{package}` may" for package in own)]
        said = f"May import {', and '.join(filter(None, parts))}." if any(parts) else "Imports no other part"
        assert said in " ".join(str(importlib.import_module(name).__doc__).split()), name

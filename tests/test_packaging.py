"""Imports of the package: importing it is cheap, and nothing imports what imports it."""

import ast
import importlib
import subprocess
import sys
import tomllib
from graphlib import TopologicalSorter
from importlib.util import resolve_name
from pathlib import Path

import warp_trunk

ROOT = Path(warp_trunk.__file__).parent
KERNELS = Path(importlib.import_module("warp_trunk.kernels").__path__[0])
HEAVY = ["rerun", "tetgen", "trimesh", "warp", "meshio", "scipy", "tyro", "rich", "matplotlib", "jinja2"]


def python(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
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
    done = subprocess.run([sys.executable, "-c", "import kernels"], cwd=tmp_path, capture_output=True, text=True)
    assert "ModuleNotFoundError" in done.stderr


def test_every_public_name_is_there():
    """The stub is what `__init__` imports from and what type checkers read."""
    tree = ast.parse((ROOT / "__init__.pyi").read_text())
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
    listed = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["tool"]["setuptools"][
        "package-data"
    ]
    no_source = {".py", ".pyc"}
    others = {path for path in ROOT.rglob("*") if path.is_file() and path.suffix not in no_source}
    assert others == {ROOT.parent / room.replace(".", "/") / name for room in listed for name in listed[room]}


def modules():
    """Every file of the package by the name of its module, without the list of public names."""
    found = {}
    for room, name in ((ROOT, "warp_trunk"), (KERNELS, "warp_trunk.kernels")):
        for path in room.rglob("*.py"):
            parts = path.relative_to(room).with_suffix("").parts
            found[".".join([name, *parts]).removesuffix(".__init__")] = path
    del found["warp_trunk"]
    return found


def imported(module, path, known):
    """The modules of the package that one imports, also in its functions, but not for types alone."""
    tree = ast.parse(path.read_text())
    branches = [n for n in ast.walk(tree) if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING"]
    for_types = {node for branch in branches for node in ast.walk(branch)}
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node not in for_types:
            source = resolve_name("." * node.level + (node.module or ""), package)
            names |= {source, *(f"{source}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import) and node not in for_types:
            names |= {alias.name for alias in node.names}
    return names & known.keys() - {module}


def test_imports_run_in_no_circle():
    """Of modules, nor of packages."""
    known = modules()
    assert {"warp_trunk.engine.model", "warp_trunk.kernels.tets", "warp_trunk.errors"} <= known.keys()
    of_modules = {module: imported(module, path, known) for module, path in known.items()}
    TopologicalSorter(of_modules).prepare()
    of_packages = dict[str, set[str]]()
    for module, others in of_modules.items():
        package, *_ = module.split(".")[1:]
        of_packages.setdefault(package, set()).update(other.split(".")[1] for other in others)
        of_packages[package].discard(package)
    TopologicalSorter(of_packages).prepare()
    assert "case" in of_packages["run"]

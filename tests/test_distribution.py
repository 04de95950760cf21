"""The wheel and the sdist hold all files of the package and nothing else."""

from __future__ import annotations

import shutil
import subprocess
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

import warp_trunk

TREE = Path(__file__).parents[1]
BESIDE = ("CHANGELOG.md", "CITATION.cff", "LICENSE", "MANIFEST.in", "README.md", "pyproject.toml", "setup.py")
"""Files of the sdist beside the package."""


def package_files(kernels: str) -> set[str]:
    """Every file of the package, whose kernels lie in a folder of this name."""
    places = ((TREE / "warp_trunk", "warp_trunk"), (TREE / "kernels", kernels))
    return {
        f"{name}/{path.relative_to(folder).as_posix()}"
        for folder, name in places
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    }


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("uv") is None, reason="uv builds them")
def test_wheel_and_sdist_hold_the_package_and_nothing_else(tmp_path: Path) -> None:
    subprocess.run(["uv", "build", "--quiet", "--out-dir", str(tmp_path), str(TREE)], check=True)
    name = f"warp_trunk-{warp_trunk.__version__}"
    with zipfile.ZipFile(tmp_path / f"{name}-py3-none-any.whl") as wheel:
        files = {entry for entry in wheel.namelist() if not entry.startswith(f"{name}.dist-info/")}
    assert files == package_files("warp_trunk/kernels")
    assert {"warp_trunk/py.typed", "warp_trunk/report/page.html", "warp_trunk/kernels/tets.py"} < files
    with tarfile.open(tmp_path / f"{name}.tar.gz") as archive:
        files = {member.name.removeprefix(f"{name}/") for member in archive if member.isfile()}
    made = {entry for entry in files if entry.startswith("warp_trunk.egg-info/")} | {"PKG-INFO", "setup.cfg"}
    assert files == package_files("kernels") | {*BESIDE} | made


def test_one_version() -> None:
    """`__init__.py` states it; CITATION.cff repeats it for those who cite."""
    project = tomllib.loads((TREE / "pyproject.toml").read_text(encoding="utf-8"))
    assert "version" not in project["project"]
    assert project["tool"]["setuptools"]["dynamic"] == {"version": {"attr": "warp_trunk.__version__"}}
    assert f"\nversion: {warp_trunk.__version__}\n" in (TREE / "CITATION.cff").read_text(encoding="utf-8")

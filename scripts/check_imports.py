"""Checks that imports keep to the order of packages in pyproject.toml and run in no circle.

    uv run python scripts/check_imports.py          # status 1 and the imports that break a contract

The linter reads a copy of the sources in which kernels/ is at its place in the package.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]


def check(root: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """The end of the linter on the sources of a checkout, and its report."""
    with tempfile.TemporaryDirectory() as folder:
        package, ignore = Path(folder) / "warp_trunk", shutil.ignore_patterns("__pycache__")
        shutil.copytree(root / "warp_trunk", package, ignore=ignore)
        shutil.copytree(root / "kernels", package / "kernels", ignore=ignore)
        linter, contracts = Path(sys.executable).with_name("lint-imports"), root / "pyproject.toml"
        command = [linter, "--no-cache", "--no-logo", contracts]
        return subprocess.run(command, cwd=folder, capture_output=True, encoding="utf-8")


if __name__ == "__main__":
    done = check()
    print(done.stdout + done.stderr)
    sys.exit(done.returncode)

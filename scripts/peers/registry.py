"""Which peers there are, what each needs, and how each was favoured."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec

from finite_elements.invariants import Law
from finite_elements.neo_hookean import Isochoric, NeoHookean, WithoutLogarithm

OURS = "warp_trunk"
SYSTEM_PYTHON = "/usr/bin/python3"
"""Has Debian's packages."""


@dataclass(frozen=True)
class Entry:
    """One peer: a module of this folder in a process of its own."""

    name: str
    """For the table."""
    module: str
    """In this folder."""
    law: type[Law]
    """Its strain energy."""
    missing: Callable[[], str | None]
    """How to install it; None where it is there."""
    favour: str
    """How it was favoured."""
    command: tuple[str, ...] = (sys.executable,)
    """What runs the module."""
    threads: int = 2
    """Of each of its processes."""


def _packages(*names: str) -> Callable[[], str | None]:
    return lambda: None if all(map(find_spec, names)) else "`uv sync --group fem`"


def _calculix() -> str | None:
    return None if shutil.which("ccx") and shutil.which("stdbuf") else "`apt-get install calculix-ccx`"


def _fenicsx() -> str | None:
    look = "import sys, dolfinx; sys.exit(not dolfinx.__version__.startswith('0.5.'))"
    there = bool(shutil.which("mpirun") and shutil.which(SYSTEM_PYTHON))
    if there and subprocess.run([SYSTEM_PYTHON, "-c", look], capture_output=True, check=False).returncode == 0:
        return None
    return "`apt-get install python3-dolfinx` on Debian 12 (FEniCSx 0.5)"


ENTRIES = (
    Entry(
        OURS,
        "with_warp_trunk",
        NeoHookean,
        lambda: None,
        "stops by its own estimate, asked for a distance at which the true error is small enough",
    ),
    Entry(
        "FEniCSx",
        "with_fenicsx",
        NeoHookean,
        _fenicsx,
        "two MPI processes, interpolation of the levels made at rest as set-up, stopped in truth",
        ("mpirun", "--allow-run-as-root", "--oversubscribe", "-n", "2", SYSTEM_PYTHON),
        threads=1,
    ),
    Entry(
        "scikit-fem + PARDISO",
        "with_scikit_fem",
        NeoHookean,
        _packages("skfem", "pypardiso"),
        "order of elimination found as set-up, factors kept while that pays, stopped in truth",
    ),
    Entry(
        "FElupe + PARDISO",
        "with_felupe",
        NeoHookean,
        _packages("felupe", "pypardiso"),
        "the same, with its own threaded assembly",
    ),
    Entry(
        "CalculiX",
        "with_calculix",
        Isochoric,
        _calculix,
        "all in one increment, its input read as set-up; stops by its own check",
    ),
    Entry(
        "Newton SolverVBD",
        "with_newton",
        WithoutLogarithm,
        _packages("newton"),
        "no inertia, momentum with restarts, stopped in truth; float32, one core (Warp on a CPU)",
    ),
)

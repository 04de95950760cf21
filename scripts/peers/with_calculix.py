"""CalculiX on its own neo-Hookean law: its program, an input file, and the file it prints displacements to."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from finite_elements.neo_hookean import Isochoric

from .task import Task
from .timing import Peer, main, peer_of

FIRST = "iteration 1"
"""The line with which set-up ends."""


class _Made:
    """An input file, and a program that has read it and is about to solve."""

    def __init__(self, task: Task) -> None:
        self.task, self.displacement = task, task.image
        self.folder = tempfile.TemporaryDirectory(prefix="calculix-")
        with (Path(self.folder.name) / "task.inp").open("w") as file:
            file.writelines(deck(task))
        # its lines one by one, to see when set-up is over
        self.process = subprocess.Popen(
            ["stdbuf", "-oL", "ccx", "task"], cwd=self.folder.name, stdout=subprocess.PIPE, text=True
        )
        self._lines_to(FIRST)

    def _lines_to(self, wanted: str | None) -> list[str]:
        """Reads what the program prints up to a line, or to its end."""
        assert self.process.stdout is not None
        lines = []
        for line in self.process.stdout:
            lines.append(line.strip())
            if lines[-1] == wanted:
                return lines
        if wanted is not None or self.process.wait() != 0:
            raise RuntimeError("ccx: " + " | ".join(lines[-5:]))
        return lines

    def solve(self, enough: Callable[[np.ndarray], bool] | None) -> dict[str, float]:
        """Waits for its end, by its own convergence check."""
        lines = self._lines_to(None)
        self.displacement = read_displacement(Path(self.folder.name) / "task.dat", len(self.task.nodes))
        if enough:
            enough(self.displacement)
        return {"steps": 1 + sum(line.startswith("iteration ") for line in lines)}


def deck(task: Task) -> list[str]:
    """The input file: one step, tried in one increment, with the held nodes moved."""
    law = Isochoric(task.youngs_modulus, task.poisson_ratio)
    lines = ["*NODE, NSET=ALL\n"]
    lines += [f"{node}, {x:.12g}, {y:.12g}, {z:.12g}\n" for node, (x, y, z) in enumerate(task.nodes.tolist(), 1)]
    lines.append("*ELEMENT, TYPE=C3D4, ELSET=TISSUE\n")
    lines += [f"{tet}, {a}, {b}, {c}, {d}\n" for tet, (a, b, c, d) in enumerate((task.tets + 1).tolist(), 1)]
    lines.append(
        f"*MATERIAL, NAME=TISSUE\n*HYPERELASTIC, NEO HOOKE\n{law.c10:.12g}, {law.d1:.12g}\n"
        "*SOLID SECTION, ELSET=TISSUE, MATERIAL=TISSUE\n"
        "*STEP, NLGEOM, INC=1000\n*STATIC\n1.0, 1.0\n*BOUNDARY\n"
    )
    held = np.flatnonzero(task.held)
    for node, motion in zip((held + 1).tolist(), task.image[held].tolist(), strict=True):
        lines += [f"{node}, {axis}, {axis}, {u:.12g}\n" for axis, u in enumerate(motion, 1)]
    lines.append("*NODE PRINT, NSET=ALL, FREQUENCY=1000\nU\n*END STEP\n")
    return lines


def read_displacement(path: Path, nodes: int) -> np.ndarray:
    """The last displacements printed, shape (nodes, 3) [mm].

    Raises:
        ValueError: not every node is there.
    """
    rows = [line.split() for line in path.read_text().split("displacements")[-1].splitlines()[1:] if line.strip()]
    table = np.array(rows, dtype=float)
    if table.shape != (nodes, 4) or (table[:, 0] != np.arange(1, nodes + 1)).any():
        raise ValueError(f"{path.name}: has displacements of shape {table.shape}, not of {nodes} nodes")
    return table[:, 1:]


def make(task: Task) -> Peer:
    """The peer."""
    told = subprocess.run(["ccx", "-v"], capture_output=True, text=True, check=False).stdout.split()
    version = f"CalculiX {told[-1] if told else ''}".strip()
    return peer_of(task, version, {"SPOOLES": partial(_Made, task)}, converges=False)


if __name__ == "__main__":
    main(make)

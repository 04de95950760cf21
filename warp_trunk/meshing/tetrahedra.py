"""Fill the space between bones and skin with tetrahedra, and give the flattest some height."""

from __future__ import annotations

import errno
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warp_trunk.engine.trunk_mesh import oriented
from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface import Surface, area_vectors, compact, unit
from warp_trunk.geometry.surface_checks import CrossingError, components, crossings, enclosed_volume, place_of
from warp_trunk.io.atomic_write import named
from warp_trunk.kernels.tet_quality import mean_ratios, move_nodes
from warp_trunk.system import DISK_FULL, ending_of

CHILD = Path(__file__).with_name("tetgen_child.py")
"""The script that runs TetGen once."""
_RUNS = 6
"""How often TetGen is run at most to meet the number asked for; one or two runs are usual."""
_WITHIN = 0.15
"""How far from the number asked for the number of tetrahedra may be."""
_AIM = 0.12
"""A run nearer than this is not followed by another."""
_PER_TRIANGLE = 1.2, 2.5
"""Tetrahedra for each triangle of closed surfaces around a space, where nothing asks for more: at least, and in a
trunk. In a layer one tetrahedron thick they are 1.5, between a fine and a coarse surface 1.24."""


@dataclass(frozen=True)
class Tetrahedra:
    """The mesh that TetGen made; the nodes of both surfaces come first, in their order."""

    nodes: np.ndarray
    """Positions [mm], shape (nodes, 3), float64: skin vertices, bone surface vertices, new nodes."""
    tets: np.ndarray
    """Node indices, each of positive volume, shape (tets, 4), int32."""
    runs: int
    """How often TetGen was run to meet the number asked for."""


def tetrahedralize(
    skin: Surface,
    bones: Surface,
    tets: int,
    radius_edge_ratio: float = 2.0,
    progress: Callable[[str], None] = lambda what: None,
) -> Tetrahedra:
    """Fill the space between the bone surface and the skin with about `tets` tetrahedra.

    Both surfaces are kept as they are, node by node: TetGen adds nodes in the space between only. Inside
    every closed part of the bone surface is a cavity. The number of tetrahedra is met by a bound on their
    volume, found from a model of its effect and corrected by what the runs show.

    Args:
        skin, bones: closed 2-manifolds, oriented outward, free of crossings, the bones inside the skin.
        tets: number of tetrahedra asked for, met within 15 %.
        radius_edge_ratio: bound on circumradius by shortest edge that TetGen aims for, above 1.
        progress: gets a sentence before each run of TetGen.

    Raises InputError when the surfaces cross, or need more tetrahedra by themselves than asked for.
    """
    check_number(tets, len(skin.faces), len(bones.faces))
    vertices = np.concatenate([skin.vertices, bones.vertices])
    faces = np.concatenate([skin.faces, bones.faces + len(skin.vertices)]).astype(np.int32)
    holes = cavity_points(bones)
    search = _BoundSearch(tets, len(faces), enclosed_volume(skin) - enclosed_volume(bones), radius_edge_ratio)
    best: Tetrahedra | None = None
    for run in range(1, _RUNS + 1):
        bound = search.next_bound()
        progress(f"run {run} of TetGen, of {_RUNS} at most")
        nodes, corners = _tetgen(Surface(vertices, faces), holes, bound, radius_edge_ratio)
        count = len(corners)
        if best is None or abs(count - tets) < abs(len(best.tets) - tets):
            best = Tetrahedra(nodes, corners, run)
        if abs(count - tets) < _AIM * tets or (count > tets and np.isinf(bound)):
            break
        search.saw(bound, count)
    assert best is not None
    count = len(best.tets)
    _check_enough(tets, count, count, len(skin.faces), len(bones.faces))
    if count < (1.0 - _WITHIN) * tets:
        reached = f"{best.runs} runs of TetGen came to {count} at best"
        raise InputError(f"tets: {tets} were asked for, but {reached}; ask for another number")
    return best


def check_number(tets: int, skin: int, bones: int = 0) -> None:
    """InputError if the triangles of the skin and the bone surface certainly need more tetrahedra."""
    surely, usually = (math.ceil(each * (skin + bones)) for each in _PER_TRIANGLE)
    _check_enough(tets, surely, usually, skin, bones)


def usual_number(skin: int, bones: int) -> int:
    """The tetrahedra that a trunk with so many triangles of skin and bone surface usually needs at least."""
    return math.ceil(_PER_TRIANGLE[1] * (skin + bones))


def _check_enough(tets: int, least: int, enough: int, skin: int, bones: int) -> None:
    """InputError where the least number of tetrahedra is above the number asked for; `enough` is the cure."""
    if least <= (1.0 + _WITHIN) * tets:
        return
    what, cure = f"the skin ({skin} triangles)", "give a coarser skin"
    if bones:
        what, cure = f"{what} and the bone surface ({bones})", f"{cure} or a longer bone_edge_length"
    need = f"{what} cannot do with fewer than {least}"
    raise InputError(f"tets: {tets} were asked for, but {need}; ask for {enough} or more, or {cure}")


def cavity_points(bones: Surface) -> np.ndarray:
    """One point well inside each connected part of a closed surface, shape (parts, 3) [mm]."""
    part_of_vertex = components(bones)
    points = []
    for part in range(part_of_vertex.max() + 1):
        surface = compact(bones.vertices, bones.faces[part_of_vertex[bones.faces[:, 0]] == part])
        normal = area_vectors(surface.vertices, surface.faces)
        area = np.linalg.norm(normal, axis=1)
        largest = np.argsort(-area)[:500]
        inward = -normal[largest] / area[largest, None]
        start = surface.vertices[surface.faces[largest]].mean(axis=1)
        size = np.sqrt(2.0 * area[largest])[:, None]
        tries = np.concatenate([start + depth * size * inward for depth in (0.02, 0.1, 0.3, 0.6, 1.0, 2.0)])
        distance = SurfaceDistance(surface).at(tries)
        deepest = int(distance.argmin())
        if distance[deepest] >= 0.0:
            place = surface.vertices.mean(axis=0).round(1).tolist()
            raise InputError(f"bones: no point inside the part near {place} mm was found; repair the bone there")
        points.append(tries[deepest])
    return np.array(points).reshape(-1, 3)


class _BoundSearch:
    """Finds the bound on the volume of a tetrahedron that gives the number asked for.

    Without a bound the surfaces decide the number N0; with a bound v on a volume V it is about
    N0 (1 + 1.2 (V / (v N0))^1.4), as seen on a trunk and on spheres. Each run corrects the factor, and
    narrows the interval that the bound must lie in.
    """

    def __init__(self, tets: int, faces: int, volume: float, radius_edge_ratio: float) -> None:
        self._tets, self._volume = tets, volume
        self._fixed = faces * (1.5 + 2.2 / radius_edge_ratio)
        self._factor = 1.2
        self._too_few = np.inf
        self._too_many = 0.0

    def next_bound(self) -> float:
        """The bound to try next [mm^3]; infinite where the surfaces should give enough by themselves."""
        surplus = self._tets / self._fixed - 1.0
        bound = np.inf
        if surplus > 0.05:
            bound = self._volume / (self._fixed * (surplus / self._factor) ** (1.0 / 1.4))
        if self._too_many < bound < self._too_few:
            return float(bound)
        if np.isinf(self._too_few):
            return np.inf
        return float(np.sqrt(max(self._too_many, 0.1 * self._too_few) * self._too_few))

    def saw(self, bound: float, count: int) -> None:
        """Learn from a run."""
        if count > self._tets:
            self._too_many = max(self._too_many, bound)
        else:
            self._too_few = min(self._too_few, bound)
        if np.isinf(bound):
            self._fixed = float(count)
            return
        self._fixed = min(self._fixed, 0.97 * count)
        load = self._volume / (bound * self._fixed)
        self._factor = max((count / self._fixed - 1.0) / load**1.4, 1e-3)


def _tetgen(both: Surface, holes: np.ndarray, bound: float, ratio: float) -> tuple[np.ndarray, np.ndarray]:
    input_vertices, failed = both.vertices, "TetGen cannot fill the space between them"
    try:
        nodes, tets = run_tetgen(vertices=input_vertices, faces=both.faces, holes=holes, bound=bound, ratio=ratio)
    except RuntimeError as error:
        pairs = crossings(both)
        if len(pairs):
            what = f"{len(pairs)} triangles cross others, the first near {place_of(both, pairs[0])}"
            cure = "repair the skin there or choose a larger bone_margin"
            raise CrossingError(f"skin and bones: {failed}, {what}; {cure}", both, pairs) from error
        cure = "look for triangles of the skin that touch, or choose a larger bone_margin"
        raise InputError(f"skin and bones: {failed} ({error}); {cure}") from error
    if len(nodes) < len(input_vertices) or not np.array_equal(nodes[: len(input_vertices)], input_vertices):
        why = "which happens when two are at the same place"
        raise InputError(f"skin: TetGen did not keep its vertices, {why}; merge vertices that coincide")
    return nodes, oriented(nodes, tets)


def run_tetgen(**arguments: Any) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and tetrahedra of a run of TetGen in a child process, which gets its input in a file.

    Raises:
        RuntimeError: TetGen refuses the surfaces, or dies.
        OSError: the folder of temporary files is full.
    """
    with tempfile.TemporaryDirectory(prefix="warp-trunk-") as folder:  # TetGen leaves files behind where it fails
        source, result = Path(folder) / "given.npz", Path(folder) / "made.npz"
        with named(source):
            np.savez(source, **arguments)
        command = [sys.executable, "-P", str(CHILD), str(source), str(result)]
        ended = subprocess.run(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False)
        if ended.returncode == DISK_FULL:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(result))
        if ended.returncode or not result.is_file():
            refusal = ended.stderr.decode(errors="replace").strip().splitlines() if ended.returncode == 1 else []
            raise RuntimeError(refusal[-1] if refusal else f"its process {ending_of(ended.returncode)}")
        with np.load(result, allow_pickle=False) as made:
            return made["nodes"], made["tets"]


_DOUBLE: Any = wp.float64
_array = partial(wp.array, device="cpu")
"""A copy for a kernel."""
_GOAL = 0.3
"""Tetrahedra of a lower quality are worked on; 1 is regular, 0 flat; 0.3 is about 9 degrees between faces."""
_SWEEPS = 6
"""How often the nodes of all such tetrahedra are tried."""
_MOVE_LENGTHS = (0.3, 0.1, 0.03)
"""Lengths of the moves tried, in mean edge lengths around the node."""


def improve_quality(nodes: np.ndarray, tets: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """Move nodes so that the worst tetrahedra get better, none below the worst of its neighbourhood.

    TetGen keeps the surfaces it is given, and where their triangles meet at a small angle, or sheets come
    near each other, flat tetrahedra are left that a deformation turns inside out. A node is moved to the best
    of some places around it, if the worst tetrahedron at the node gets better by that.

    Args:
        nodes: positions [mm], shape (nodes, 3).
        tets: node indices, of positive volume, shape (tets, 4).
        reach: how far each node may be moved from where it is [mm], 0 not at all, shape (nodes,).

    Returns positions [mm], shape (nodes, 3).
    """
    moved, reached = _array(nodes, dtype=wp.vec3d), _array(reach, dtype=wp.float64)
    quality = _array(mean_ratio(nodes[tets]), dtype=wp.float64)
    order = np.argsort(tets.reshape(-1), kind="stable")
    start = np.searchsorted(tets.reshape(-1)[order], np.arange(len(nodes) + 1))
    mesh = [_array(tets, dtype=wp.vec4i), _array(start, dtype=wp.int32), _array(order // 4, dtype=wp.int32)]
    around, start_places = _array(_directions(), dtype=wp.vec3d), _array(nodes, dtype=wp.vec3d)
    for _ in range(_SWEEPS):
        now = quality.numpy()
        bad = np.flatnonzero(now < _GOAL)
        bad = bad[np.argsort(now[bad])]
        _, first = np.unique(tets[bad], return_index=True)
        turns = _array(tets[bad].reshape(-1)[np.sort(first)], wp.int32)
        moves = wp.zeros(1, dtype=wp.int32, device="cpu")
        inputs, outputs = [turns, _GOAL, *mesh, around, reached, start_places], [moved, quality, moves]
        wp.launch(move_nodes, dim=1, inputs=inputs, outputs=outputs, device="cpu")
        if not moves.numpy()[0]:
            break
    return moved.numpy()


def mean_ratio(corners: np.ndarray) -> np.ndarray:
    """Quality of tetrahedra given by corners (n, 4, 3): 12 (3 V)^(2/3) / sum of squared edges.

    1 for a regular tetrahedron, 0 for a flat one, negative for an inverted one.
    """
    quality = wp.empty(len(corners), dtype=_DOUBLE, device="cpu")
    inputs = [_array(corners, dtype=wp.vec3d)]
    wp.launch(mean_ratios, dim=len(corners), inputs=inputs, outputs=[quality], device="cpu")
    return quality.numpy()


def _directions() -> np.ndarray:
    """Moves to try, in all directions and some lengths, shape (moves, 3)."""
    lattice = np.stack(np.meshgrid(*([-1.0, 0.0, 1.0],) * 3), axis=-1).reshape(-1, 3)
    lattice = unit(lattice[np.abs(lattice).sum(axis=1) > 0.0])
    return np.concatenate([step * lattice for step in _MOVE_LENGTHS])

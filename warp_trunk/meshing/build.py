"""From skin and bones to the mesh that is simulated."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta

from warp_trunk.case import Case
from warp_trunk.checking import check_fields, checked
from warp_trunk.engine.trunk_mesh import TrunkMesh, check_trunk
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface, check_surface
from warp_trunk.geometry.surface_checks import check_solid, crossings, enclosed_volume

from .cache import cache_key, load_cached, store_cached

if TYPE_CHECKING:
    from .bone_surface import BoneSurface
    from .tetrahedra import Tetrahedra


@dataclass(frozen=True, kw_only=True)
class MeshOptions:
    """How a trunk is meshed.

    >>> wt.MeshOptions(tets=60_000).bone_voxel
    4.0
    """

    tets: Annotated[int, Meta(ge=4, le=50_000_000)] = 225_000
    """Requested number of tetrahedra, met within 15 %."""
    bone_margin: Annotated[float, Meta(ge=0.0, le=100.0, description="mm")] = 2.0
    """Least distance of bones from the skin [mm]; bones that are nearer are cut back."""
    bone_voxel: Annotated[float, Meta(ge=0.1, le=100.0, description="mm")] = 4.0
    """Grid spacing of the bone surface [mm]; a bone thinner than this may break into pieces."""
    bone_edge_length: Annotated[float, Meta(ge=0.0, le=1000.0, description="mm")] = 0.0
    """Edges of the bone surface shorter than this are collapsed [mm]; 0 chooses it from `tets`."""
    bone_tolerance: Annotated[float, Meta(ge=0.0, le=100.0, description="mm")] = 1.0
    """How far the collapse of edges may move the bone surface [mm]; the repair of flat tetrahedra may move it
    by half of that."""
    radius_edge_ratio: Annotated[float, Meta(ge=1.01, le=100.0)] = 2.0
    """Quality bound: circumradius by shortest edge of a tetrahedron, above 1; lower is better."""

    def __post_init__(self) -> None:
        check_fields(self, "mesh")


@dataclass(frozen=True)
class TrunkBuild:
    """A mesh and how it was made."""

    trunk: TrunkMesh
    """The mesh."""
    from_cache: bool
    """Whether it was read from the cache."""
    surface_seconds: float
    """Time the bone surface took [s]; 0 from the cache."""
    mesh_seconds: float
    """Time the tetrahedra took, or reading them from the cache [s]."""


@checked
def make_trunk(
    skin: Surface,
    bones: Mapping[str, Surface],
    options: MeshOptions | None = None,
    progress: Callable[[str], None] | None = None,
    *,
    cache: bool = True,
) -> TrunkBuild:
    """Mesh the soft tissue between bones and skin, or fetch the mesh from the cache.

    Args:
        skin: the closed skin; its vertices keep their identity and order in the mesh.
        bones: closed bone surfaces by name; they may overlap and cross.
        options: how; MeshOptions() if not given.
        progress: gets the name of each stage as it begins.
        cache: whether the mesh is kept on disk, and reused for the same surfaces and options.

    Raises InputError when the skin is not closed, 2-manifold, oriented outward and free of
    self-intersections, when no clean surface can be made of the bones, or when the number of tets asked for
    cannot be met: at once where the skin alone needs more, and before TetGen runs where the surfaces surely do.
    """
    options = options or MeshOptions()
    if not bones:
        raise InputError("make_trunk: 'bones' is empty; give the surface of each bone by its name")
    tell = progress or (lambda what: None)
    start = time.perf_counter()
    key = cache_key(skin, bones, repr(sorted(asdict(options).items())))
    if cache and (cached := load_cached(key)) is not None:
        return TrunkBuild(cached, True, 0.0, time.perf_counter() - start)
    from .bone_surface import bone_surface  # bring Warp
    from .tetrahedra import check_number, tetrahedralize, usual_number

    check_number(options.tets, len(skin.faces))
    tell("checking the skin")
    check_surface(skin, "skin")
    check_solid(skin, "skin")
    tell("making one surface of the bones")
    # 0.7 times the edge of a regular tetrahedron of the average volume leaves most of them to the space between
    average = 0.7 * (6.0 * math.sqrt(2.0) * (enclosed_volume(skin) / options.tets)) ** (1.0 / 3.0)
    edge_length = options.bone_edge_length or average
    surface = bone_surface(
        skin, bones, options.bone_margin, options.bone_voxel, edge_length, options.bone_tolerance
    )
    usual = usual_number(len(skin.faces), len(surface.surface.faces))
    if usual > 1.15 * options.tets:
        text = f"skin and bones usually need {usual} tetrahedra; {options.tets} were asked for and may not be met"
        warnings.warn(text, stacklevel=2)
    between = time.perf_counter()
    tell("filling the soft tissue with tetrahedra")
    filled = tetrahedralize(skin, surface.surface, options.tets, options.radius_edge_ratio, tell)
    tell("repairing flat tetrahedra")
    nodes = _mended(filled, len(skin.vertices), surface.surface, 0.5 * options.bone_tolerance)
    trunk = _ordered(nodes, filled.tets, skin, surface, tuple(bones))
    check_trunk(trunk, "mesh")
    if cache:
        store_cached(key, trunk)
    end = time.perf_counter()
    return TrunkBuild(trunk, False, between - start, end - between)


def _mended(filled: Tetrahedra, skin_count: int, bones: Surface, bone_reach: float) -> np.ndarray:
    """Nodes after the repair of flat tetrahedra; those of the skin stay, those of bone move by bone_reach at
    most."""
    from .tetrahedra import improve_quality  # brings Warp

    reach = np.full(len(filled.nodes), np.inf)
    reach[:skin_count] = 0.0
    on_bone = slice(skin_count, skin_count + len(bones.vertices))
    reach[on_bone] = bone_reach
    while True:
        nodes = improve_quality(filled.nodes, filled.tets, reach)
        # nothing but this keeps the two sides of a thin bone apart: there are no tetrahedra in it
        crossed = crossings(Surface(nodes[on_bone], bones.faces))
        held = bones.faces[crossed] + skin_count
        if not reach[held].any():
            return nodes
        reach[held] = 0.0


def _ordered(
    nodes: np.ndarray, tets: np.ndarray, skin: Surface, surface: BoneSurface, names: tuple[str, ...]
) -> TrunkMesh:
    """The mesh with nodes along a space-filling curve and tetrahedra by their lowest node."""
    order = morton_order(nodes)
    number = np.argsort(order).astype(np.int32)
    skin_count, bone_count = len(skin.vertices), len(surface.bone)
    bone = np.full(len(nodes), -1, dtype=np.int32)
    bone[number[skin_count : skin_count + bone_count]] = surface.bone
    tets = number[tets]
    tets = tets[np.lexsort(np.sort(tets, axis=1).T[::-1])]
    return TrunkMesh(
        nodes=np.ascontiguousarray(nodes[order]),
        tets=np.ascontiguousarray(tets),
        skin_nodes=number[:skin_count],
        skin_faces=skin.faces.astype(np.int32),
        bone=bone,
        bone_names=names,
        bone_faces=number[surface.surface.faces + skin_count],
    )


_BITS = 21
"""Bits of each coordinate; three times this fits an integer of 64 bits."""


def morton_order(points: np.ndarray) -> np.ndarray:
    """Indices that put points (n, 3) along a Morton curve (Z-order) of their bounding cube, shape (n,)."""
    lower = points.min(axis=0)
    size = max(float((points.max(axis=0) - lower).max()), 1e-300)
    cell = np.minimum((points - lower) * (2.0**_BITS / size), 2**_BITS - 1).astype(np.uint64)
    code = _spread(cell[:, 0]) | (_spread(cell[:, 1]) << np.uint64(1)) | (_spread(cell[:, 2]) << np.uint64(2))
    return np.argsort(code, kind="stable")


def _spread(bits: np.ndarray) -> np.ndarray:
    """Put two zero bits between the bits of each number."""
    masks = (0x1F00000000FFFF, 0x1F0000FF0000FF, 0x100F00F00F00F00F, 0x10C30C30C30C30C3, 0x1249249249249249)
    for shift, mask in zip((32, 16, 8, 4, 2), masks, strict=True):
        bits = (bits | (bits << np.uint64(shift))) & np.uint64(mask)
    return bits


def predicted_skin(case: Case, trunk: TrunkMesh, displacement: np.ndarray) -> Surface:
    """The skin of a case, same vertices and faces, moved with the nodes' displacement (nodes, 3) [mm]."""
    return case.skin.moved(case.skin.vertices + displacement[trunk.skin_nodes])

"""How the rib cage follows the spine: each rib a rigid body, pinned at its head and turned by stated shares."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.anatomy import rib_of
from warp_trunk.geometry.rigid import RigidMotion, nearest_rotation, rotated

if TYPE_CHECKING:
    from warp_trunk.case.rib_coupling import RibCoupling
    from warp_trunk.geometry.surface import Surface

    from .vertebra_motion import Vertebrae

_TRUE_RIBS = 7
"""Ribs down to this one reach the sternum."""
_LOWEST = 12
"""The lowest rib, which nothing ties to the sternum: the tilt of ribs below the true ones grows towards it."""
_UNDER_SCAPULA = range(2, 8)
"""The ribs that a shoulder blade lies on."""
_REACH = 20.0
"""Parts of them within this distance of the blade carry it; the muscles between are thinner [mm]."""
_FEW = 16
"""One in this many vertices is used to estimate the distance of a bone."""
_END = 5.0
"""How much of a bone is its end: what is this much further from a joint, or nearer to the tip, counts [mm]."""
_CARTILAGE = 0.1
"""A costal cartilage keeps its length within this part."""
_FEWEST = 3
"""Fewer ribs carry neither sternum nor shoulder blade."""
_FACET = 3.0
"""A head leaves its facet by at most this much where screws turn the vertebra [mm]."""


@dataclass(frozen=True)
class _Rib:
    """A rib before."""

    vertebra: str
    """Its vertebra."""
    head: np.ndarray
    """Where it meets its vertebra [mm], shape (3,)."""
    tip: np.ndarray
    """Its front end [mm], shape (3,)."""
    number: int
    """From 1, the highest, to 12."""


class _Together:
    """Points of several bodies, to which one rigid motion is fitted.

    The sum of outer products of the points before and after needs no more of a body than the number of its points,
    their sum and the sum of their outer products.
    """

    def __init__(self, points: Mapping[str, np.ndarray]) -> None:
        """Of the points of each body by name, (n, 3) [mm]."""
        self._count = np.array([len(those) for those in points.values()], dtype=float)
        self._total = np.array([those.sum(axis=0) for those in points.values()])
        self._middle = self._total.sum(axis=0) / self._count.sum()
        self._arms = self._total - self._count[:, None] * self._middle
        self._outer = np.array([(those - self._middle).T @ those for those in points.values()])
        self.names = tuple(points)
        """The bodies."""

    def motion(self, motions: RigidMotion) -> RigidMotion:
        """The rigid motion nearest to those of the bodies (..., bodies) at their points, shape (...)."""
        turned = self._outer @ np.swapaxes(motions.rotation, -1, -2)
        spread = (turned + self._arms[:, :, None] * motions.translation[..., None, :]).sum(axis=-3)
        after = rotated(motions.rotation, self._total) + self._count[:, None] * motions.translation
        return RigidMotion.about(nearest_rotation(spread), self._middle, after.sum(axis=-2) / self._count.sum())


class RibCage:
    """Ribs, sternum and shoulder blades of a patient before surgery, and where they hang together."""

    def __init__(self, bones: Mapping[str, Surface], levels: Iterable[str]) -> None:
        """Finds the ends of the ribs, and what carries sternum and shoulder blades.

        Args:
            bones: surfaces by name: `rib_left_01` to `rib_right_12`, `sternum`, `scapula_left`, `T1` to `T12`.
            levels: the vertebrae that lead ribs; other ribs are left out.
        """
        self.ribs: dict[str, _Rib] = {}
        for name, bone in bones.items():
            rib = rib_of(name)
            if rib and rib.vertebra in bones and rib.vertebra in levels:
                head, tip = ends(bone, bones[rib.vertebra])
                self.ribs[name] = _Rib(rib.vertebra, head, tip, rib.number)
        true = {name: rib.tip for name, rib in self.ribs.items() if rib.number <= _TRUE_RIBS}
        self.depth = max((float(np.linalg.norm(rib.tip - rib.head)) for rib in self.ribs.values()), default=1.0)
        """Of the cage: the longest way from the head of a rib to its front end [mm]."""
        self.anchors: dict[str, np.ndarray] = {}
        """The point of the sternum nearest to the front end of each true rib [mm]."""
        if "sternum" in bones:
            vertices = bones["sternum"].vertices
            self.anchors = {
                n: vertices[np.linalg.norm(vertices - tip, axis=1).argmin()] for n, tip in true.items()
            }
        self.carried: dict[str, _Together] = {}
        """The parts of ribs, of three at least, that carry the sternum and each shoulder blade."""
        if "sternum" in bones and len(true) >= _FEWEST:
            self.carried["sternum"] = _Together({name: tip[None] for name, tip in true.items()})
        for side in ("left", "right"):
            near = {
                rib: _within(_REACH, bones[rib].vertices, bones[f"scapula_{side}"].vertices)
                for rib in (f"rib_{side}_{number:02d}" for number in _UNDER_SCAPULA)
                if f"scapula_{side}" in bones and rib in self.ribs
            }
            near = {rib: points for rib, points in near.items() if len(points)}
            if len(near) >= _FEWEST:
                self.carried[f"scapula_{side}"] = _Together(near)
        self.bones = {*self.ribs, *self.carried} | ({"sternum"} & bones.keys())
        """All that may follow."""


def follow(
    cage: RibCage,
    vertebrae: Vertebrae,
    coupling: RibCoupling,
    known: Mapping[str, RigidMotion] | None = None,
    *,
    growing: bool = False,
) -> dict[str, RigidMotion]:
    """How ribs, sternum and shoulder blades move as the vertebrae do, the pelvis at rest.

    A rib takes all of the motion of its head, all of flexion, and shares of its vertebra's rotation, bending and
    sideways way. The sternum moves as one rigid body, nearest to the front ends of the ribs 1 to 7; then each of
    these turns about its head by as little as keeps its cartilage within 10 % of its length. Front ends of the
    ribs 8 to 10 are free: the cartilage of each meets that of the rib above in a joint. Of a turn that screws
    force on a vertebra at the same curve the ribs take a share of its own, and their heads lag behind their
    facets by up to 3 mm.

    Args:
        cage: before surgery.
        vertebrae: how those of the cage's levels move, in one set of landmarks or many.
        coupling: what of it reaches a rib.
        known: motions of ribs, sternum and shoulder blades that are known, which the others follow.
        growing: whether a curve grows, and bone and cartilage with it, as where it is imposed on straight
            anatomy: the highest and the floating ribs then keep their attitude as others do.

    Returns:
        A motion for each other rib that has a vertebra; for the sternum where three ribs reach it, and for each
        shoulder blade that lies on three ribs, where they are not known [mm], shape (...) each.
    """
    found = dict(known or {})
    free = {name: rib for name, rib in cage.ribs.items() if name not in found}
    if free:
        moved = _turned(list(free.values()), vertebrae, coupling, cage.depth, growing)
        found |= {name: moved.last(number) for number, name in enumerate(free)}

    def carried(bone: str) -> RigidMotion:
        ribs = cage.carried[bone]
        return ribs.motion(RigidMotion.stack(found[rib] for rib in ribs.names))

    if "sternum" in cage.carried and "sternum" not in found:
        found["sternum"] = carried("sternum")
    reaching = [name for name in cage.anchors if name in free and "sternum" in found]
    if reaching:
        anchors = np.array([cage.anchors[name] for name in reaching])
        moved = RigidMotion.stack(found[name] for name in reaching)
        moved = _reaching([free[name] for name in reaching], anchors, moved, found["sternum"])
        found |= {name: moved.last(number) for number, name in enumerate(reaching)}
    for blade in cage.carried.keys() - found.keys():
        found[blade] = carried(blade).part(coupling.scapula)
    return {name: motion for name, motion in found.items() if name not in (known or {})}


def _within(reach: float, points: np.ndarray, of: np.ndarray) -> np.ndarray:
    """Those of some points that are at most so far from the nearest of others."""
    from scipy.spatial import KDTree  # heavy

    return points[KDTree(of).query(points, distance_upper_bound=reach)[0] <= reach]


def ends(bone: Surface, neighbour: Surface) -> np.ndarray:
    """The middle of the end of a bone at its neighbour, and of the end furthest from there, shape (2, 3)."""
    from scipy.spatial import KDTree  # heavy

    vertices, tree = bone.vertices, KDTree(neighbour.vertices)
    # what is further is no end, and is not looked for
    bound = tree.query(vertices[::_FEW])[0].min() + 1.001 * _END
    near, _ = tree.query(vertices, distance_upper_bound=bound)
    joint = vertices[near <= near.min() + _END].mean(axis=0)
    far = np.linalg.norm(vertices - joint, axis=1)
    return np.array([joint, vertices[far >= far.max() - _END].mean(axis=0)])


def _turned(
    ribs: Sequence[_Rib], vertebrae: Vertebrae, coupling: RibCoupling, depth: float, growing: bool
) -> RigidMotion:
    """The ribs' motions by their shares, before the sternum is taken into account, shape (..., ribs)."""
    head, number = np.array([rib.head for rib in ribs]), np.array([rib.number for rib in ribs])
    vertebra = vertebrae.parts([rib.vertebra for rib in ribs])
    lag = -np.arcsin(np.clip((1.0 - coupling.shift) * vertebra.shift / depth, -1.0, 1.0))
    with_curve, transfer = vertebra.axial_rotation - vertebra.derotation, coupling.derotation_transfer
    turn = coupling.reversible_part * coupling.axial_rotation * with_curve + transfer * vertebra.derotation + lag
    below = np.maximum(0.0, (number - _TRUE_RIBS) / (_LOWEST - _TRUE_RIBS)) * (not growing)
    above = np.maximum(0.0, (_TRUE_RIBS - number) / (_TRUE_RIBS - 1)) * (not growing)
    bending = coupling.reversible_part * coupling.lateral_bending
    bending = bending + below * coupling.floating + above * coupling.upper
    rotation = vertebra.share(axial_rotation=turn, lateral_bending=bending)
    facet = vertebra.motion.apply(head)
    behind = vertebra.without((1.0 - transfer) * vertebra.derotation, head) - facet
    far = np.linalg.norm(behind, axis=-1, keepdims=True)
    return RigidMotion.about(rotation, head, facet + behind * np.minimum(1.0, _FACET / np.maximum(far, 1e-9)))


def _reaching(
    ribs: Sequence[_Rib], anchors: np.ndarray, motions: RigidMotion, sternum: RigidMotion
) -> RigidMotion:
    """The motions (..., ribs) turned about the ribs' heads by as little as leaves cartilages their length."""
    head, tip = np.array([rib.head for rib in ribs]), np.array([rib.tip for rib in ribs])
    length = np.linalg.norm(tip - anchors, axis=-1)
    pin, end = motions.apply(head), motions.apply(tip)
    goal = RigidMotion(sternum.rotation[..., None, :, :], sternum.translation[..., None, :]).apply(anchors)
    now = np.linalg.norm(end - goal, axis=-1)
    wanted = np.clip(now, (1.0 - _CARTILAGE) * length, (1.0 + _CARTILAGE) * length)
    across = np.cross(goal - pin, end - pin)
    size = np.linalg.norm(across, axis=-1)
    # in the plane of the rib and the goal, by the law of cosines; as near as it goes where it cannot reach
    far, long = np.linalg.norm(goal - pin, axis=-1), np.linalg.norm(end - pin, axis=-1)
    angle = np.arccos(np.clip((far**2 + long**2 - wanted**2) / np.maximum(2.0 * far * long, 1e-300), -1.0, 1.0))
    angle -= np.arctan2(size, ((goal - pin) * (end - pin)).sum(axis=-1))
    angle = np.where((wanted == now) | (size == 0.0), 0.0, angle) / np.maximum(size, 1e-300)
    turn = RigidMotion.exp(np.concatenate([angle[..., None] * across, np.zeros_like(across)], axis=-1)).rotation
    return RigidMotion.about(turn, pin, pin) * motions

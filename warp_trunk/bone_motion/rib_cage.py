"""How the rib cage follows the spine: each rib a rigid body, pinned at its head and turned by stated shares."""

from __future__ import annotations

from collections.abc import Container, Mapping

import numpy as np

from warp_trunk.case.anatomy import SIDES, TRUE_RIBS, rib_of
from warp_trunk.case.rib_coupling import RibCoupling
from warp_trunk.geometry.rigid import NamedMotions, RigidMotion, cross_matrix, nearest_rotation, rotated
from warp_trunk.geometry.surface import Surface

from .vertebra_motion import Vertebrae

_LOWEST = 12
"""The lowest rib, which nothing ties to the sternum: the tilt of ribs below the true ones grows towards it."""
_UNDER_SCAPULA = range(2, 8)
"""The ribs that a shoulder blade lies on."""
_REACH = 20.0
"""Parts of them within this distance of the blade carry it; the muscles between are thinner [mm]."""
_SAMPLED = 16
"""One in this many vertices is used to estimate the distance of a bone."""
_END = 5.0
"""How much of a bone is its end: what is this much further from a joint, or nearer to the tip, counts [mm]."""
_CARTILAGE = 0.1
"""A costal cartilage keeps its length within this part."""
_FEWEST_RIBS = 3
"""Fewer ribs carry neither sternum nor shoulder blade."""
_FACET = 3.0
"""A head leaves its facet by at most this much where screws turn the vertebra [mm]."""


class _Riders:
    """Bones that ride on parts of ribs: to the points of each one rigid motion is fitted.

    The sum of outer products of the points before and after needs no more of a part than the number of its points,
    their sum and the sum of their outer products.
    """

    def __init__(self, points: Mapping[str, Mapping[str, np.ndarray]]) -> None:
        """Of the points (n, 3) of each part by rib, of some bones by name [mm]."""
        self.names, self._ribs = (
            tuple(points),
            list(dict.fromkeys(rib for parts in points.values() for rib in parts)),
        )
        parts = [[each.get(rib, np.empty((0, 3))) for rib in self._ribs] for each in points.values()]
        self._count = np.array([[[len(part)] for part in each] for each in parts], dtype=float)
        self._total = np.array([[part.sum(axis=0) for part in each] for each in parts])
        self._all = self._count.sum(axis=1)
        self._middle = self._total.sum(axis=1) / self._all
        self._arms = self._total - self._count * self._middle[:, None]
        self._outer = np.array(
            [[(part - middle).T @ part for part in each] for each, middle in zip(parts, self._middle, strict=True)]
        )

    def motion(self, motions: NamedMotions) -> RigidMotion:
        """The rigid motions nearest to those of the ribs at their points, shape (..., bones)."""
        ribs = motions.of(self._ribs).last(None)
        ribs = RigidMotion(np.swapaxes(ribs.rotation, -3, -4), np.swapaxes(ribs.translation, -2, -3))
        turned = self._outer @ np.swapaxes(ribs.rotation, -1, -2)
        spread = (turned + self._arms[..., None] * ribs.translation[..., None, :]).sum(axis=-3)
        after = (rotated(ribs.rotation, self._total) + self._count * ribs.translation).sum(axis=-2)
        return RigidMotion.about(nearest_rotation(spread), self._middle, after / self._all)


class RibCage:
    """Ribs, sternum and shoulder blades of a patient before surgery, and where they hang together."""

    def __init__(self, bones: Mapping[str, Surface], levels: Container[str]) -> None:
        """Finds the ends of the ribs, and what carries sternum and shoulder blades.

        Args:
            bones: surfaces by name: `rib_left_01` to `rib_right_12`, `sternum`, `scapula_left`, `T1` to `T12`.
            levels: the vertebrae that lead ribs; other ribs are left out.
        """
        ribs = {name: rib for name in bones if (rib := rib_of(name)) and rib.vertebra in bones}
        ribs = {name: rib for name, rib in ribs.items() if rib.vertebra in levels}
        self.ribs = tuple(ribs)
        """Their names; arrays below have them in this order."""
        self.vertebrae = [rib.vertebra for rib in ribs.values()]
        """The vertebra of each."""
        self.number = np.array([rib.number for rib in ribs.values()], dtype=int)
        """From 1, the highest, to 12, shape (ribs,)."""
        both = np.array([ends(bones[name], bones[rib.vertebra]) for name, rib in ribs.items()]).reshape(-1, 2, 3)
        self.head, self.tip = both[:, 0], both[:, 1]
        """Where each meets its vertebra, and its front end [mm], shape (ribs, 3) each."""
        self.depth = float(np.linalg.norm(self.tip - self.head, axis=1).max(initial=0.0)) or 1.0
        """Of the cage: the longest way from the head of a rib to its front end [mm]."""
        true = np.flatnonzero(self.number <= TRUE_RIBS)
        sternum = bones["sternum"].vertices if "sternum" in bones else np.empty((0, 3))
        self.reaching = true if len(sternum) else true[:0]
        """Rows of the ribs that reach the sternum."""
        self.anchors = np.full_like(self.tip, np.nan)
        """The point of the sternum nearest to the front end of each of these [mm], shape (ribs, 3)."""
        for row in self.reaching:
            self.anchors[row] = sternum[np.linalg.norm(sternum - self.tip[row], axis=1).argmin()]
        enough = len(self.reaching) >= _FEWEST_RIBS
        self.sternum = _Riders({"sternum": {self.ribs[row]: self.tip[[row]] for row in true}}) if enough else None
        """The sternum on the front ends of true ribs, of three at least."""
        near = {
            f"scapula_{side}": {
                rib: points
                for rib in (f"rib_{side}_{number:02d}" for number in _UNDER_SCAPULA)
                if rib in ribs
                and len(points := _within(_REACH, bones[rib].vertices, bones[f"scapula_{side}"].vertices))
            }
            for side in SIDES
            if f"scapula_{side}" in bones
        }
        near = {blade: parts for blade, parts in near.items() if len(parts) >= _FEWEST_RIBS}
        self.blades = _Riders(near) if near else None
        """Shoulder blades on the parts of ribs under them, of three at least."""
        self.bones = (*ribs, *(["sternum"] if "sternum" in bones else []), *near)
        """All that may follow."""


def follow(
    cage: RibCage,
    vertebrae: Vertebrae,
    coupling: RibCoupling,
    prescribed: Mapping[str, RigidMotion] | None = None,
    *,
    growing: bool = False,
) -> NamedMotions:
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
        prescribed: motions of ribs, sternum and shoulder blades that are known, which the others follow.
        growing: whether a curve grows, and bone and cartilage with it, as where it is imposed on straight
            anatomy: the highest and the floating ribs then keep their attitude as others do.

    Returns:
        Those known, and a motion for each other rib that has a vertebra; for the sternum where three ribs reach
        it, and for each shoulder blade that lies on three ribs [mm], shape (...) each.
    """
    motions = NamedMotions(cage.bones, *vertebrae.motion.shape[:-1])
    for name in cage.bones:
        if prescribed and name in prescribed:
            motions[name] = prescribed[name]
    free = np.array([name not in motions for name in cage.ribs], dtype=bool)
    if free.any():
        rows = np.flatnonzero(free)
        motions.put([cage.ribs[row] for row in rows], _turned(cage, rows, vertebrae, coupling, growing))
    if cage.sternum and "sternum" not in motions:
        motions.put(["sternum"], cage.sternum.motion(motions))
    rows = cage.reaching[free[cage.reaching]]
    if len(rows) and "sternum" in motions:
        reaching = [cage.ribs[row] for row in rows]
        motions.put(reaching, _reaching(cage, rows, motions.of(reaching), motions["sternum"]))
    if cage.blades and (unknown := [name for name in cage.blades.names if name not in motions]):
        carried = NamedMotions(cage.blades.names, *vertebrae.motion.shape[:-1])
        carried.put(cage.blades.names, cage.blades.motion(motions).part(coupling.scapula))
        motions.put(unknown, carried.of(unknown))
    return motions


def _within(reach: float, points: np.ndarray, of: np.ndarray) -> np.ndarray:
    """Those of some points that are at most so far from the nearest of others."""
    from scipy.spatial import KDTree  # heavy

    return points[KDTree(of).query(points, distance_upper_bound=reach)[0] <= reach]


def ends(bone: Surface, neighbour: Surface) -> np.ndarray:
    """The middle of the end of a bone at its neighbour, and of the end furthest from there, shape (2, 3)."""
    from scipy.spatial import KDTree  # heavy

    vertices, tree = bone.vertices, KDTree(neighbour.vertices)
    # what is further is no end, and is not looked for
    bound = tree.query(vertices[::_SAMPLED])[0].min() + 1.001 * _END
    near, _ = tree.query(vertices, distance_upper_bound=bound)
    joint = vertices[near <= near.min() + _END].mean(axis=0)
    far = np.linalg.norm(vertices - joint, axis=1)
    return np.array([joint, vertices[far >= far.max() - _END].mean(axis=0)])


def _turned(
    cage: RibCage, rows: np.ndarray, vertebrae: Vertebrae, coupling: RibCoupling, growing: bool
) -> RigidMotion:
    """The motions of some ribs by their shares, before the sternum is taken into account, shape (..., ribs)."""
    head, number, depth = cage.head[rows], cage.number[rows], cage.depth
    vertebra = vertebrae.parts([cage.vertebrae[row] for row in rows])
    lag = -np.arcsin(np.clip((1.0 - coupling.shift) * vertebra.shift / depth, -1.0, 1.0))
    with_curve, transfer = vertebra.axial_rotation - vertebra.derotation, coupling.derotation_transfer
    turn = coupling.reversible_part * coupling.axial_rotation * with_curve + transfer * vertebra.derotation + lag
    below = np.maximum(0.0, (number - TRUE_RIBS) / (_LOWEST - TRUE_RIBS)) * (not growing)
    above = np.maximum(0.0, (TRUE_RIBS - number) / (TRUE_RIBS - 1)) * (not growing)
    bending = coupling.reversible_part * coupling.lateral_bending
    bending = bending + below * coupling.floating + above * coupling.upper
    rotation = vertebra.share(axial_rotation=turn, lateral_bending=bending)
    facet = vertebra.motion.apply(head)
    behind = vertebra.without((1.0 - transfer) * vertebra.derotation, head) - facet
    far = np.linalg.norm(behind, axis=-1, keepdims=True)
    return RigidMotion.about(rotation, head, facet + behind * np.minimum(1.0, _FACET / np.maximum(far, 1e-9)))


def _reaching(cage: RibCage, rows: np.ndarray, motions: RigidMotion, sternum: RigidMotion) -> RigidMotion:
    """Motions (..., ribs) turned about the ribs' heads by as little as leaves cartilages their length."""
    head, tip, anchors = cage.head[rows], cage.tip[rows], cage.anchors[rows]
    length = np.linalg.norm(tip - anchors, axis=-1)
    pin, end = motions.apply(head), motions.apply(tip)
    goal = sternum.last(None).apply(anchors)
    now = np.linalg.norm(end - goal, axis=-1)
    wanted = np.clip(now, (1.0 - _CARTILAGE) * length, (1.0 + _CARTILAGE) * length)
    across = rotated(cross_matrix(goal - pin), end - pin)
    size = np.linalg.norm(across, axis=-1)
    # in the plane of the rib and the goal, by the law of cosines; as near as it goes where it cannot reach
    far, long = np.linalg.norm(goal - pin, axis=-1), np.linalg.norm(end - pin, axis=-1)
    angle = np.arccos(np.clip((far**2 + long**2 - wanted**2) / np.maximum(2.0 * far * long, 1e-300), -1.0, 1.0))
    angle -= np.arctan2(size, ((goal - pin) * (end - pin)).sum(axis=-1))
    angle = np.where((wanted == now) | (size == 0.0), 0.0, angle) / np.maximum(size, 1e-300)
    turn = RigidMotion.exp(np.concatenate([angle[..., None] * across, np.zeros_like(across)], axis=-1)).rotation
    return RigidMotion.about(turn, pin, pin) * motions

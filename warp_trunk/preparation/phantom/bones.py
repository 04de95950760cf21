"""The bones of the phantom: vertebrae, ribs, sternum and pelvis as tubes of analytic sections.

All lengths are at the reference size of `trunk_skin`, from which the bones take their place: spinous
processes a stated depth under the furrow of the back, ribs under the sides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warp_trunk.case.anatomy import SIDES, VERTEBRAE
from warp_trunk.case.landmarks import VERTEBRA_POINTS, Landmarks
from warp_trunk.geometry.section import arc_length, points_along
from warp_trunk.geometry.surface import Surface, unit

from .skin import section_at

_TOP, _BOTTOM = 514.0, 128.0  # z of the middle of T1 and of L5 [mm]
_UNDER_SKIN = 11.0  # from the tip of a spinous process to the skin [mm]
_BODY = 0.4  # half height of a vertebral body over the pitch; the rest is disc
_LAMINA = 20.0  # from the back of the body to the root of the spinous process [mm]
_BODY_RING, _PEDICLE_RING = 3, 7  # those with landmarks
_AROUND = 16  # vertices of a ring of a vertebra; a multiple of 8, so that landmarks are vertices

# At T1, T6, T12, L5: half width and half depth of the body, half width over the transverse processes, length
# and drop of the spinous process [mm]
_LEVELS = np.array([0.0, 5.0, 11.0, 16.0])
_SIZES = np.array(
    [
        [14.0, 10.0, 25.0, 20.0, 10.0],
        [14.0, 13.5, 28.0, 20.0, 13.0],
        [19.5, 16.0, 23.0, 18.0, 6.0],
        [25.0, 18.0, 36.0, 19.0, 4.0],
    ]
)

# Half width of the rib cage at heights z, to the middle of the ribs [mm]
_CAGE_HEIGHTS = np.array([200.0, 240.0, 280.0, 320.0, 360.0, 400.0, 440.0, 470.0, 495.0, 520.0])
_CAGE_HALF_WIDTHS = np.array([93.0, 94.0, 98.0, 103.0, 107.0, 107.0, 101.0, 90.0, 76.0, 62.0])
_UNDER_BACK = np.array([18.0, 18.0, 18.0, 18.0, 18.0, 18.0, 18.0, 18.0, 19.0, 20.0])  # from a rib to the skin [mm]
_UNDER_FRONT = 18.0
# Where ribs 1 to 12 end: z [mm], and the angle round the trunk from the left (0) to the front (-90 degrees)
_RIB_END_HEIGHTS = (476.0, 454.0, 432.0, 410.0, 388.0, 366.0, 344.0, 321.0, 298.0, 274.0, 252.0, 240.0)
_RIB_END_ANGLES = (-58.0, -62.0, -65.0, -66.0, -66.0, -65.0, -63.0, -57.0, -50.0, -38.0, -8.0, 30.0)
_RIB = (4.9, 4.9)  # half thickness and half height of a rib [mm]


@dataclass(frozen=True)
class _Vertebra:
    """Place and size of one vertebra; its axes are the patient's left, its own back and its own up."""

    centre: np.ndarray
    """Middle of the body [mm], shape (3,)."""
    back: np.ndarray
    """Unit vector from front to back, shape (3,)."""
    up: np.ndarray
    """Unit vector along the spine, shape (3,)."""
    half_height: float
    """Of the body [mm]."""
    half_width: float
    """Of the body [mm]."""
    half_depth: float
    """Of the body [mm]."""
    transverse: float
    """Half width over the transverse processes [mm]."""
    spinous: float
    """Length of the spinous process behind the lamina [mm]."""
    drop: float
    """How far the tip of the spinous process is below the middle of the body [mm]."""

    def at(self, left: float, back: float, up: float) -> np.ndarray:
        """A point by its distances from the middle of the body [mm]."""
        return self.centre + [left, 0.0, 0.0] + back * self.back + up * self.up


def skeleton() -> tuple[dict[str, Surface], Landmarks]:
    """All bones by name, mirror images of each other in x = 0, and their landmarks.

    Each bone is closed, free of self-intersections and at least 8 mm thick nearly everywhere. Ribs overlap
    their vertebra a little, and the hip bones the sacrum.
    """
    spine = _spine()
    bones: dict[str, Surface] = {}
    names: list[str] = []
    points: list[np.ndarray] = []
    for name, vertebra in spine.items():
        bones[name], six = _vertebra(vertebra)
        names += [f"{name}_{point}" for point in VERTEBRA_POINTS]
        points += list(six)
    for number, vertebra in enumerate(list(spine.values())[:12], start=1):
        left = _rib(number, vertebra)
        bones[f"rib_left_{number:02d}"], bones[f"rib_right_{number:02d}"] = left, _mirrored(left)
    bones["sternum"] = _sternum()
    bones["sacrum"] = _sacrum(spine["L5"])
    hip = _hip()
    bones["hip_left"], bones["hip_right"] = hip, _mirrored(hip)
    for side in SIDES:
        names.append(f"asis_{side}")
        points.append(bones[f"hip_{side}"].vertices[-1])
    return bones, Landmarks(tuple(names), np.array(points))


def _mirrored(surface: Surface) -> Surface:
    return Surface(surface.vertices * [-1.0, 1.0, 1.0], surface.faces[:, ::-1].copy())


def _spine() -> dict[str, _Vertebra]:
    """Vertebrae from T1 to L5 under the furrow of the back, each along the line that they make."""
    weights = np.concatenate([np.linspace(0.92, 1.06, 12), np.linspace(1.3, 1.42, 5)])
    steps = (weights[:-1] + weights[1:]) / 2.0
    unit = (_TOP - _BOTTOM) / steps.sum()
    heights = _TOP - unit * np.concatenate([[0.0], np.cumsum(steps)])

    def place(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        level = np.interp(-z, -heights, np.arange(len(heights)))
        sizes = np.stack([np.interp(level, _LEVELS, column) for column in _SIZES.T], axis=1)
        skin = section_at(z)
        behind = sizes[:, 1] + _LAMINA + sizes[:, 3]
        return skin.back - skin.groove - _UNDER_SKIN - behind, sizes

    y, sizes = place(heights)
    line = np.polynomial.Polynomial.fit(heights, y, 6)  # smooth, as a spine is
    slope = line.deriv()(heights)
    spine = {}
    for k, name in enumerate(VERTEBRAE):
        up = np.array([0.0, slope[k], 1.0]) / np.hypot(slope[k], 1.0)
        spine[name] = _Vertebra(
            np.array([0.0, line(heights[k]), heights[k]]),
            np.array([0.0, up[2], -up[1]]),
            up,
            _BODY * unit * weights[k],
            *map(float, sizes[k]),
        )
    return spine


def _vertebra(v: _Vertebra) -> tuple[Surface, np.ndarray]:
    """A vertebra and its six landmarks, shape (6, 3) [mm], which are vertices of it.

    One tube from front to back: body, pedicles, transverse processes, lamina and spinous process. Its rings
    lie in parallel planes, so it cannot cross itself. There is no canal.
    """
    w, d, h = v.half_width, v.half_depth, v.half_height
    arch = max(0.55 * h, 4.6)  # half height of pedicles and transverse processes
    lift = h - arch - 0.5  # they spring from the upper half of the body
    bar = max(0.45 * h, 4.4)
    # back, half width, half height, up of the middle
    rings = np.array(
        [
            [-1.0 * d, 0.0, 0.0, 0.0],
            [-0.96 * d, 0.5 * w, 0.86 * h, 0.0],
            [-0.72 * d, 0.86 * w, h, 0.0],
            [-0.3 * d, w, h, 0.0],
            [0.0, w, h, 0.0],
            [0.4 * d, 0.97 * w, h, 0.0],
            [0.8 * d, 0.8 * w, 0.96 * h, 0.0],
            [d + 1.0, 0.7 * w, arch, lift],
            [d + 5.0, 0.68 * w, arch, lift],
            [d + 8.0, 0.75 * w, arch, lift],
            [d + 10.0, 0.95 * v.transverse, bar, lift],
            [d + 13.5, v.transverse, bar, lift - 0.5],
            [d + 17.0, 0.95 * v.transverse, bar, lift - 1.0],
            [d + 19.0, 10.0, arch + 0.5, lift - 2.0],
            [d + _LAMINA + 3.0, 6.0, 6.0, -0.15 * v.drop],
            [d + _LAMINA + 0.55 * v.spinous, 4.8, 5.6, -0.6 * v.drop],
            [d + _LAMINA + 0.9 * v.spinous, 4.6, 5.2, -0.95 * v.drop],
            [d + _LAMINA + 0.97 * v.spinous, 3.2, 3.6, -v.drop],
            [d + _LAMINA + v.spinous, 0.0, 0.0, -v.drop],
        ]
    )
    centres = v.centre + rings[:, :1] * v.back + rings[:, 3:] * v.up
    count = len(rings)
    # the tube runs to the back along side x up, so its side is the patient's right
    side = np.tile([-1.0, 0.0, 0.0], (count, 1))
    body = tube(centres, side, np.tile(v.up, (count, 1)), rings[:, 1], rings[:, 2], around=_AROUND, exponent=2.6)

    def vertex(ring: int, eighth: int) -> np.ndarray:
        return body.vertices[1 + ring * _AROUND + eighth * _AROUND // 8]

    six = [vertex(_BODY_RING, 2), vertex(_BODY_RING, 6)]
    six += [vertex(_PEDICLE_RING, eighth) for eighth in (3, 5, 1, 7)]
    return body, np.array(six)


def _rib(number: int, v: _Vertebra) -> Surface:
    """The left rib: from the back of the body past the transverse process and round the cage to the front."""
    from scipy.interpolate import PchipInterpolator  # heavy

    end_height, end_angle = _RIB_END_HEIGHTS[number - 1], _RIB_END_ANGLES[number - 1]
    head = v.at(0.85 * v.half_width, 0.75 * v.half_depth, 0.2 * v.half_height)
    neck = v.at(v.transverse + 2.0, v.half_depth + 14.0, 0.1 * v.half_height)
    angles = np.radians(np.linspace(56.0, end_angle, max(3, round((56.0 - end_angle) / 14.0))))
    start = neck[2] - 4.0
    z = start + (end_height - start) * np.linspace(0.0, 1.0, len(angles)) ** 1.15
    skin = section_at(z)
    a = PchipInterpolator(_CAGE_HEIGHTS, _CAGE_HALF_WIDTHS)(z)
    front = skin.front + _UNDER_FRONT
    back = skin.back - np.interp(z, _CAGE_HEIGHTS, _UNDER_BACK)
    c, s = np.cos(angles), np.sin(angles)
    around = np.stack([a * c, (front + back) / 2.0 + (back - front) / 2.0 * s, z], axis=1)
    guide = np.concatenate([[head, neck], around])
    thickness, height = np.full(len(guide), _RIB[0]), np.full(len(guide), _RIB[1])
    return rod(guide, thickness, height, np.array([0.0, 0.0, 1.0]), spacing=7.0)


def _sternum() -> Surface:
    z = np.array([488.0, 462.0, 440.0, 405.0, 370.0, 344.0])
    y = section_at(z).front + 15.0
    guide = np.stack([np.zeros_like(z), y, z], axis=1)
    width = np.array([20.0, 23.0, 15.0, 16.0, 15.0, 8.0])
    return rod(guide, np.full(len(z), 5.5), width, np.array([1.0, 0.0, 0.0]), spacing=8.0, around=12)


def _sacrum(last: _Vertebra) -> Surface:
    top = last.at(0.0, 3.0, -last.half_height - 4.0)
    guide = np.array([top, [0.0, 34.0, 82.0], [0.0, 50.0, 54.0], [0.0, 54.0, 27.0]])
    thickness, width = np.array([14.0, 15.0, 10.0, 7.0]), np.array([33.0, 42.0, 29.0, 10.0])
    return rod(guide, thickness, width, np.array([1.0, 0.0, 0.0]), spacing=8.0, around=14)


def _hip() -> Surface:
    """The left hip bone: a wing from the sacrum round the side to the ASIS, its last vertex."""
    x = np.array([38.0, 58.0, 84.0, 107.0, 118.0, 117.0, 107.0])
    y = np.array([46.0, 44.0, 30.0, 6.0, -20.0, -41.0, -57.0])
    z = np.array([88.0, 90.0, 90.0, 89.0, 89.0, 91.0, 94.0])
    thickness = np.array([7.5, 8.5, 9.0, 10.0, 9.5, 7.5, 6.5])
    height = np.array([30.0, 44.0, 54.0, 54.0, 45.0, 30.0, 16.0])
    return rod(np.stack([x, y, z], axis=1), thickness, height, np.array([0.2, 0.0, 1.0]), spacing=8.0, around=16)


def tube(
    centres: np.ndarray,
    side: np.ndarray,
    up: np.ndarray,
    half_side: np.ndarray,
    half_up: np.ndarray,
    *,
    around: int = 12,
    exponent: float = 2.0,
) -> Surface:
    """A closed surface through superelliptic rings, with a point at each end.

    Ring k holds the vertices 1 + k * around + j, at angle 2 pi j / around from `side` towards `up`. The first
    vertex and the last are the ends; the first and the last centre stand for them, and their half widths are
    not used. The tube runs along side x up.

    Args:
        centres: shape (rings + 2, 3) [mm].
        side: unit vectors across the tube, shape (rings + 2, 3).
        up: unit vectors across both, shape (rings + 2, 3).
        half_side: half widths along `side` [mm], shape (rings + 2,).
        half_up: half widths along `up` [mm], shape (rings + 2,).
        around: vertices of a ring.
        exponent: 2 is an ellipse, more is closer to a rectangle.
    """
    angle = 2.0 * np.pi * np.arange(around) / around
    c, s = np.cos(angle), np.sin(angle)
    c, s = (np.sign(f) * np.abs(np.round(f, 15)) ** (2.0 / exponent) for f in (c, s))
    inner = slice(1, -1)
    rings = (
        centres[inner, None]
        + (half_side[inner, None] * c)[..., None] * side[inner, None]
        + (half_up[inner, None] * s)[..., None] * up[inner, None]
    )
    count = len(centres) - 2
    vertices = np.concatenate([centres[:1], rings.reshape(-1, 3), centres[-1:]])
    j, k = np.arange(around), (np.arange(around) + 1) % around
    faces = [np.stack([np.zeros_like(j), 1 + k, 1 + j], axis=1)]
    for ring in range(count - 1):
        ring_start, next_ring = 1 + ring * around, 1 + (ring + 1) * around
        faces.append(np.stack([ring_start + j, ring_start + k, next_ring + k], axis=1))
        faces.append(np.stack([ring_start + j, next_ring + k, next_ring + j], axis=1))
    last = 1 + (count - 1) * around
    faces.append(np.stack([last + j, last + k, np.full_like(j, len(vertices) - 1)], axis=1))
    return Surface(vertices, np.concatenate(faces).astype(np.int32))


def rod(
    guide: np.ndarray,
    half_side: np.ndarray,
    half_up: np.ndarray,
    up: np.ndarray,
    spacing: float,
    *,
    around: int = 10,
) -> Surface:
    """A tube with rounded ends along a smooth curve through guiding points.

    Args:
        guide: points the curve goes through, the first and the last the ends, shape (n, 3) [mm].
        half_side: half widths at these points across `up` [mm], shape (n,).
        half_up: half widths at these points along `up` [mm], shape (n,).
        up: direction of `half_up`, as near as can be, shape (3,).
        spacing: wanted distance between rings [mm].
        around: vertices of a ring.
    """
    from scipy.interpolate import CubicSpline, PchipInterpolator  # heavy

    chord = arc_length(guide)
    fine = np.linspace(0.0, chord[-1], 400)
    curve = CubicSpline(chord, guide)(fine)
    length = arc_length(curve)
    cap = float(half_side[0] + half_side[-1]) / 2.0  # ends are half ellipsoids of this length
    caps = cap * np.array([0.0, 0.12, 0.5])
    middle = np.linspace(cap, length[-1] - cap, max(2, 1 + round((length[-1] - 2.0 * cap) / spacing)))
    places = np.concatenate([caps, middle, length[-1] - caps[::-1]])
    to_end = np.minimum(places, length[-1] - places)
    share = np.sqrt(1.0 - np.clip(1.0 - to_end / cap, 0.0, 1.0) ** 2)
    centres = points_along(curve, places)
    forward = unit(np.gradient(centres, axis=0))
    across = unit(up - (forward @ up)[:, None] * forward)
    side = np.cross(across, forward)
    widths = PchipInterpolator(chord, np.stack([half_side, half_up], axis=1))(np.interp(places, length, fine))
    return tube(centres, side, across, share * widths[:, 0], share * widths[:, 1], around=around)

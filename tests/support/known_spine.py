"""Spines built from the angles of their vertebrae, before and after surgery, and mistakes in marking them."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from warp_trunk.case.landmarks import Landmarks

LEVELS = (*(f"T{i}" for i in range(1, 13)), *(f"L{i}" for i in range(1, 6)))
BODY, DISC = 20.0, 6.0
"""Heights of a vertebra and of the disc below it, along the vertebra's axis [mm]."""


def known_spine(
    to_left: Mapping[str, float] | None = None,
    back: Mapping[str, float] | None = None,
    turned: Mapping[str, float] | None = None,
    *,
    levels: Sequence[str] = LEVELS,
    top: tuple[float, float, float] = (0.0, 40.0, 400.0),
) -> Landmarks:
    """Vertebrae stacked from the top along their axes, with iliac spines 240 mm apart.

    Args:
        to_left: tilt of each axis seen from the front [degrees], at some levels, linear between them, else 0.
        back: tilt seen from the side, positive backwards, likewise.
        turned: axial rotation, positive where the right side stands further back, likewise.
        levels: names from top to bottom.
        top: centre of the first upper endplate [mm].
    """
    names, points, place = [], [], np.array(top)
    a, b, c = (np.radians(_at(levels, angles)) for angles in (to_left, back, turned))
    for i, level in enumerate(levels):
        up = np.array([np.tan(a[i]), np.tan(b[i]), 1.0])  # seen from the front and the side it has these tilts
        up /= np.linalg.norm(up)
        middle = place - 0.5 * BODY * up
        across = np.array([np.cos(c[i]), -np.sin(c[i]), 0.0])
        backwards = np.array([np.sin(c[i]), np.cos(c[i]), 0.0])
        names += [f"{level}_superior_endplate", f"{level}_inferior_endplate"]
        points += [place, place - BODY * up]
        for side, sign in (("left", 1.0), ("right", -1.0)):
            for end, high in (("superior", 5.0), ("inferior", -5.0)):
                names.append(f"{level}_{side}_pedicle_{end}")
                points.append(middle + 12.0 * sign * across + 15.0 * backwards + [0.0, 0.0, high])
        place = place - (BODY + DISC) * up
    names += ["asis_left", "asis_right"]
    points += [np.array([120.0, -60.0, -60.0]), np.array([-120.0, -60.0, -60.0])]
    return Landmarks(tuple(names), np.array(points))


def _at(levels: Sequence[str], angles: Mapping[str, float] | None) -> np.ndarray:
    if not angles:
        return np.zeros(len(levels))
    return np.interp(np.arange(len(levels)), [levels.index(level) for level in angles], list(angles.values()))


def before_and_after() -> tuple[Landmarks, Landmarks]:
    """A right thoracic curve of 40 degrees with a turned apex, and the same with every vertebra moved."""
    before = known_spine(
        {"T4": -20.0, "T11": 20.0, "L5": 0.0}, {"T1": 25.0, "T12": -15.0}, {"T8": 15.0, "L2": 0.0}
    )
    points = before.points.copy()
    for number, level in enumerate(LEVELS):
        own = [i for i, name in enumerate(before.names) if name.startswith(f"{level}_")]
        centre = points[own].mean(axis=0)
        turn = Rotation.from_euler("yz", [6.0 * np.cos(0.4 * number), 4.0 * np.sin(0.3 * number)], degrees=True)
        points[own] = turn.apply(points[own] - centre) + centre + [8.0 * np.sin(0.2 * number), 0.0, 1.0]
    return before, Landmarks(before.names, points)


def exchanged(landmarks: Landmarks, *pairs: tuple[str, str]) -> Landmarks:
    """The points of two names exchanged, or of two vertebrae where both are whole levels."""
    points = landmarks.points.copy()
    for first, other in pairs:
        for name in landmarks.names:
            if name == first or name.startswith(f"{first}_"):
                twin = landmarks.names.index(other + name.removeprefix(first))
                own = landmarks.names.index(name)
                points[[own, twin]] = points[[twin, own]]
    return Landmarks(landmarks.names, points)


def shifted(landmarks: Landmarks, name: str, by: tuple[float, float, float]) -> Landmarks:
    """One point moved [mm]."""
    points = landmarks.points.copy()
    points[landmarks.index(name)] += by
    return Landmarks(landmarks.names, points)


def with_errors(landmarks: Landmarks, random: np.random.Generator) -> Landmarks:
    """Every point off in any direction, by a length of 2.1 +- 1.5 mm, gamma distributed."""
    length = random.gamma(1.96, 2.1 / 1.96, (len(landmarks.names), 1))
    direction = random.standard_normal((len(landmarks.names), 3))
    return Landmarks(
        landmarks.names, landmarks.points + length * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    )

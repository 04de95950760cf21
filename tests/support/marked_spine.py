"""A curved spine before and after surgery, each vertebra moved rigidly, and mistakes in marking it."""

import numpy as np
from scipy.spatial.transform import Rotation

from support.known_spine import LEVELS, known_spine
from warp_trunk.case.landmarks import Landmarks


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
    for one, other in pairs:
        for name in landmarks.names:
            if name == one or name.startswith(f"{one}_"):
                twin = landmarks.names.index(other + name.removeprefix(one))
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

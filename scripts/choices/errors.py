"""Random errors of what the clinic gives: landmarks and the shape of bones.

Both sizes are those that the papers state of their reconstruction from two radiographs (section 2 of [1], section
5.2 of [2]). Only what they state is drawn: an error of 3.5 +- 4.1 mm has a longer tail than the one here.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from warp_trunk import Landmarks, Surface
from warp_trunk.geometry.rigid import fit_rigid

LANDMARK_MEAN, LANDMARK_SD = 2.1, 1.5
"""Length of the error of a landmark [mm]."""
BONE_MEAN = 3.5
"""Mean length of the error of a bone's surface [mm]."""
SMOOTH = 40.0
"""Points of a bone this far apart [mm] have errors with a correlation of exp(-1/2): a vertebra is shifted as a
whole, a rib is bent."""
WAVES = 200
"""Waves that a smooth field is made of."""


def moved_landmarks(landmarks: Landmarks, random: np.random.Generator) -> Landmarks:
    """The landmarks with an error each: any direction, and a length of the stated mean and standard deviation.

    The length is gamma distributed: positive, with any mean and deviation.
    """
    variance = LANDMARK_SD**2
    length = random.gamma(LANDMARK_MEAN**2 / variance, variance / LANDMARK_MEAN, (len(landmarks.names), 1))
    direction = random.standard_normal((len(landmarks.names), 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return Landmarks(landmarks.names, landmarks.points + length * direction)


def carried_along(before: Landmarks, after: Landmarks, found: Landmarks) -> Landmarks:
    """Landmarks found before surgery where a plan takes them: each vertebra's by its own rigid motion."""
    points = found.points + after.points - before.points
    for level in before.vertebrae():
        rows = [row for row, name in enumerate(before.names) if name.startswith(f"{level}_")]
        points[rows] = fit_rigid(before.points[rows], after.points[rows]).apply(found.points[rows])
    return Landmarks(after.names, points)


def moved_bones(bones: Mapping[str, Surface], mean: float, random: np.random.Generator) -> dict[str, Surface]:
    """The bones, each displaced by a smooth random field of its own.

    Args:
        bones: surfaces by name [mm].
        mean: length of the displacement, averaged over the vertices of all bones [mm].
        random: where the fields come from.
    """
    fields = {name: smooth_field(bone.vertices, random) for name, bone in bones.items()}
    scale = mean / np.linalg.norm(np.concatenate(list(fields.values())), axis=1).mean()
    return {name: Surface(bone.vertices + scale * fields[name], bone.faces) for name, bone in bones.items()}


def smooth_field(points: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A Gaussian random field of unit variance and correlation exp(-(distance / SMOOTH)^2 / 2), shape (n, 3).

    A sum of waves whose directions and lengths are drawn from the field's spectrum (Rahimi and Recht 2007).
    """
    wave = random.standard_normal((3, WAVES)) / SMOOTH
    phase = random.uniform(0.0, 2.0 * np.pi, WAVES)
    return np.sqrt(2.0 / WAVES) * np.cos(points @ wave + phase) @ random.standard_normal((WAVES, 3))

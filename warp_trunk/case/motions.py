"""Motions of named bones: motions.toml read, written and turned into rigid motions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from warp_trunk.checking import check_fields, checked
from warp_trunk.geometry.rigid import RigidMotion
from warp_trunk.io.file_access import check_within
from warp_trunk.io.records import as_record, read_toml, toml_text
from warp_trunk.io.transform_file import read_transform, rigid

from .axes import Axes

Vector = tuple[float, float, float]
Row = tuple[float, float, float, float]
Matrix = tuple[Row, Row, Row, Row]


class Turn(msgspec.Struct, frozen=True, kw_only=True):
    """A rotation about an axis through a point, by the right-hand rule."""

    degrees: float
    """Angle."""
    axis: Vector
    """Direction of the axis, of any length but 0."""
    point: Vector
    """A point on the axis [mm]."""

    def __post_init__(self) -> None:
        """Raises InputError for a field of another type."""
        check_fields(self, "rotation")


class Motion(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The motion of a bone from before to after surgery, in LPS and mm: a rotation and then a translation, or a
    transform, or fractions of the motions of other bones.

    >>> forward = wt.Motion(translation=(0.0, -6.0, 0.0))  # 6 mm, for -y is the front
    >>> dataclasses.replace(case, motions={"sternum": forward}).motions["sternum"].translation
    (0.0, -6.0, 0.0)
    """

    translation: Vector = (0.0, 0.0, 0.0)
    """After the rotation [mm]."""
    rotation: Turn | None = None
    """About a point."""
    transform: Matrix | None = None
    """A rigid 4x4 matrix that carries points before to points after [mm]."""
    follows: dict[str, float] | None = None
    """Fractions of the motions of other bones, by their names; their sum is at most 1."""
    large: bool = False
    """Whether the motion may exceed `LARGEST`."""

    def __post_init__(self) -> None:
        """Raises InputError for a field of another type."""
        check_fields(self, "motion")


class _Entry(Motion, frozen=True, kw_only=True):
    """A table of motions.toml, whose transform may be the name of a file."""

    transform: str | Matrix | None = None  # pyright: ignore[reportIncompatibleVariableOverride]


@checked
def read_motions(path: str | Path, axes: Axes | None = None, within: Path | None = None) -> dict[str, Motion]:
    """Read a table for each bone that moves, such as

        [mandible]
        translation = [0.0, -6.0, 0.0]
        rotation = { degrees = 2.0, axis = [1.0, 0.0, 0.0], point = [0.0, -99.8, 1499.1] }
        [hyoid]
        follows = { mandible = 0.5 }
        [zygomatic_left]
        transform = "zygomatic_left.tfm"

    Lengths are in mm. A transform is the name of a file beside this one (`read_transform`), or a 4x4 matrix.

    >>> _ = (folder / "motions.toml").write_text("[sternum]\\ntranslation = [0.0, -6.0, 0.0]")
    >>> wt.read_motions(folder / "motions.toml")["sternum"].translation
    (0.0, -6.0, 0.0)

    Args:
        path: the file.
        axes: those of its vectors and matrices; LPS when left out. ITK transforms are in LPS always.
        within: a folder in which every file must lie; anywhere when left out.

    Returns:
        The motions by the names of bones, in LPS.

    Raises:
        InputError: a file is missing or cannot be read, an unknown key, a value of another type, or a transform
            that scales or mirrors. `check_motions` compares the motions with the bones.
    """
    path, axes = Path(path), axes or Axes("LPS")
    if within is not None:
        check_within(within, path)
    tables = read_toml(path, "motions of bones were expected")
    return {bone: _motion(path, bone, table, axes, within) for bone, table in tables.items()}


def _motion(path: Path, bone: str, table: Any, axes: Axes, within: Path | None) -> Motion:
    entry = as_record(table, _Entry, f"{path}: [{bone}]")
    transform = entry.transform
    if isinstance(transform, str):
        file = path.parent / transform
        if within is not None:
            check_within(within, file)
        transform = _rows(read_transform(file, axes.matrix))
    elif transform is not None:
        change = np.eye(4)
        change[:3, :3] = axes.matrix
        transform = _rows(change @ rigid(np.array(transform), f"{path}: [{bone}]") @ change.T)

    def lps(vector: Vector) -> Vector:
        x, y, z = axes.points_to_lps(np.array([vector]))[0].tolist()
        return x, y, z

    turn = entry.rotation
    return Motion(
        translation=lps(entry.translation),
        rotation=turn and Turn(degrees=turn.degrees, axis=lps(turn.axis), point=lps(turn.point)),
        transform=transform,
        follows=entry.follows,
        large=entry.large,
    )


def _rows(matrix: np.ndarray) -> Matrix:
    return msgspec.convert(matrix.tolist(), Matrix)


def motions_text(motions: Mapping[str, Motion]) -> str:
    """The text of motions.toml, in LPS, which `read_motions` reads back."""
    return toml_text({bone: msgspec.to_builtins(motion) for bone, motion in motions.items()})


def rigid_motions(motions: Mapping[str, Motion]) -> dict[str, RigidMotion]:
    """The rigid motion of each named bone.

    The motion of a bone that follows others is the sum of their exponential coordinates, weighted by its
    fractions.

    Args:
        motions: those that `check_motions` accepts.
    """

    def motion_of(bone: str) -> RigidMotion:
        if bone not in motions:
            return RigidMotion.identity()
        motion = motions[bone]
        if motion.transform is not None:
            return RigidMotion.from_matrix(np.array(motion.transform))
        if motion.follows is not None:
            screws = [share * motion_of(other).log() for other, share in motion.follows.items()]
            return RigidMotion.exp(np.sum(screws, axis=0))
        shift = np.array(motion.translation)
        if (turn := motion.rotation) is None:
            return RigidMotion(np.eye(3), shift)
        axis, point = np.array(turn.axis), np.array(turn.point)
        about = np.append(np.radians(turn.degrees) * axis / np.linalg.norm(axis), np.zeros(3))
        return RigidMotion.about(RigidMotion.exp(about).rotation, point, point + shift)

    return {bone: motion_of(bone) for bone in motions}

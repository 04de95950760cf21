"""How named bones are said to move: motions.toml, read, written and turned into rigid motions."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.io.file_access import check_within, read_text
from warp_trunk.io.transform_file import read_transform, rigid

from .axes import Axes
from .keys import quoted, shown

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

FILE = "motions.toml"
"""The file of a case folder that says how bones move."""
_MOST = 1_000_000
Vector = tuple[float, float, float]
Row = tuple[float, float, float, float]
Matrix = tuple[Row, Row, Row, Row]


class Turn(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A rotation about an axis through a point, by the right-hand rule."""

    degrees: float
    """Angle."""
    axis: Vector
    """Direction of the axis, of any length but 0."""
    point: Vector
    """A point on the axis [mm]."""


class Motion(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """How a bone moves from before to after surgery, in LPS and mm: a rotation and then a translation, or a
    transform, or shares of the motions of other bones.

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
    """Shares of the motions of other bones, by their names; what is missing to 1 stays at rest."""
    large: bool = False
    """Whether the motion is meant to be larger than `motion_checks.LARGEST`."""


class _Entry(Motion, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of motions.toml, whose transform may be the name of a file."""

    transform: str | Matrix | None = None  # pyright: ignore[reportIncompatibleVariableOverride]


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
            that scales or mirrors. Whether the motions suit the bones `check_motions` tells.
    """
    path, axes = Path(path), axes or Axes("LPS")
    if within is not None:
        check_within(within, path)
    try:
        tables = tomllib.loads(read_text(path, "motions of bones were expected", _MOST))
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: cannot be read as TOML ({error}); correct it there") from error
    return {bone: _motion(path, bone, table, axes, within) for bone, table in tables.items()}


def _motion(path: Path, bone: str, table: object, axes: Axes, within: Path | None) -> Motion:
    if not isinstance(table, dict):
        raise InputError(f"{path}: '{bone}' must be a table [{bone}] of a motion, not {shown(table)}; correct it")
    try:
        entry = msgspec.convert(table, _Entry)
    except msgspec.ValidationError as error:
        keys = ", ".join(Motion.__struct_fields__)
        raise InputError(f"{path}: [{bone}]: {error}; the keys are {keys}") from error
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
    lines: list[str] = []
    for bone, motion in motions.items():
        lines.append(f"[{quoted(bone)}]\n")
        lines += [f"{key} = {_toml(value)}\n" for key, value in msgspec.to_builtins(motion).items()]
    return "".join(lines)


def _toml(value: object) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{quoted(key)} = {_toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return str(value).lower()


def rigid_motions(motions: Mapping[str, Motion], still: Iterable[str] = ()) -> dict[str, RigidTransform]:
    """The rigid motion of each bone that is named, and the identity for those that stand still.

    A bone that follows others moves on the mean of their screws, weighted by its shares: the sum of their
    exponential coordinates.

    Args:
        motions: those that `motion_checks.check_motions` accepts.
        still: other bones.
    """
    from scipy.spatial.transform import RigidTransform, Rotation  # heavy

    found: dict[str, RigidTransform] = dict.fromkeys(still, RigidTransform.identity())

    def motion_of(bone: str) -> RigidTransform:
        if bone not in motions:
            return RigidTransform.identity()
        given = motions[bone]
        if given.transform is not None:
            return RigidTransform.from_matrix(np.array(given.transform))
        if given.follows is not None:
            screws = [share * motion_of(other).as_exp_coords() for other, share in given.follows.items()]
            return RigidTransform.from_exp_coords(np.sum(screws, axis=0))
        shift, rotation = np.array(given.translation), Rotation.identity()
        if (turn := given.rotation) is not None:
            axis, point = np.array(turn.axis), np.array(turn.point)
            rotation = Rotation.from_rotvec(np.radians(turn.degrees) * axis / np.linalg.norm(axis))
            shift = shift + point - rotation.apply(point)
        return RigidTransform.from_components(shift, rotation)

    return found | {bone: motion_of(bone) for bone in motions}

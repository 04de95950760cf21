"""Label maps of a spine of blocks, as segmentation programs write them."""

import gzip
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from voxelise_case import grid_around, label_map, total_segmentator_name, write_labels

from support.blocks import spine_and_hips
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.label_maps.mask import Mask
from warp_trunk.preparation.label_maps.sources import TABLES

LEVELS = ("T5", "T6", "T7", "T8")
NUMBERS = {name: number for number, name in TABLES["totalsegmentator-v2"].items()}
NAMES = {number: name for name, number in NUMBERS.items()}
OBLIQUE = np.array([[0.98, -0.17, 0.10], [0.18, 0.98, -0.05], [-0.09, 0.07, 0.99]])
"""Nearly orthonormal; `grid` makes it so."""


class Voxels:
    """A grid of voxels, turned and perhaps mirrored, around a box [mm]."""

    def __init__(self, low: np.ndarray, high: np.ndarray, spacing: tuple[float, ...], turn: np.ndarray) -> None:
        self.affine = np.eye(4)
        self.affine[:3, :3] = turn * np.array(spacing)
        corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
        own = corners @ np.linalg.inv(self.affine[:3, :3]).T
        self.affine[:3, 3] = self.affine[:3, :3] @ np.floor(own.min(axis=0))
        self.shape = tuple((np.ceil(np.ptp(own, axis=0)).astype(int) + 1).tolist())
        self.points = np.argwhere(np.ones(self.shape)) @ self.affine[:3, :3].T + self.affine[:3, 3]

    def mask(self, inside: np.ndarray) -> Mask:
        """The voxels at these points, shape (n,) bool."""
        return Mask(inside.reshape(self.shape), (0, 0, 0), self.affine, self.shape)


def bones() -> dict[str, Surface]:
    """Four vertebrae with a canal, and hip bones."""
    return {name: bone for name, bone in spine_and_hips().items() if name in (*LEVELS, "hip_left", "hip_right")}


def grid(spacing: tuple[float, float, float], mirrored: bool = False, oblique: bool = False) -> Any:
    """Affine and shape of a grid around the bones."""
    turn = np.linalg.qr(OBLIQUE)[0] * np.sign(np.diag(np.linalg.qr(OBLIQUE)[1])) if oblique else np.eye(3)
    every = Surface(np.vstack([bone.vertices for bone in bones().values()]), np.zeros((0, 3), dtype=np.int32))
    return grid_around(every, spacing, turn * [-1.0 if mirrored else 1.0, 1.0, 1.0])


@cache
def labels() -> tuple[np.ndarray, np.ndarray]:
    """The bones on voxels of 1.5 mm with the numbers of TotalSegmentator v2, and the affine."""
    affine, shape = grid((1.5, 1.5, 1.5))
    return label_map(
        [(NUMBERS[total_segmentator_name(name)], bone) for name, bone in bones().items()], affine, shape
    ), affine


def body() -> tuple[np.ndarray, np.ndarray]:
    """A trunk of elliptic sections around the bones on voxels of 4 mm, 440 mm tall, and its affine."""
    affine = np.diag([4.0, 4.0, 4.0, 1.0])
    affine[:3, 3] = -160.0, -130.0, -60.0
    i, j, k = np.meshgrid(*map(np.arange, (80, 65, 125)), indexing="ij")
    x, y, z = (4.0 * n + o for n, o in zip((i, j, k), affine[:3, 3], strict=True))
    inside = ((x / 135.0) ** 2 + (y / 105.0) ** 2 < 1.0) & (np.abs(z - 190.0) < 220.0)
    return inside.astype(np.uint8), affine


def write_map(folder: Path) -> tuple[Path, Path]:
    """The label map with names, and the mask of the body."""
    write_labels(folder / "labels.nii.gz", *labels(), NAMES)
    write_labels(folder / "body.nii.gz", *body())
    return folder / "labels.nii.gz", folder / "body.nii.gz"


def write_masks(folder: Path) -> Path:
    """One mask for each class, empty ones too, and one of the body."""
    folder.mkdir()
    values, affine = labels()
    for name in (*(total_segmentator_name(bone) for bone in bones()), "vertebrae_T9", "spleen"):
        write_labels(folder / f"{name}.nii.gz", (values == NUMBERS.get(name, 1)).astype(np.uint8), affine)
    write_labels(folder / "body.nii.gz", *body())
    return folder


def write_nrrd(
    path: Path, values: np.ndarray, affine: np.ndarray, keys: Mapping[str, str] = {}, **fields: str | None
) -> Path:
    """An NRRD, packed by gzip; of four dimensions the first numbers the layers.

    Args:
        path: the file.
        values: shape (i, j, k) or (layers, i, j, k).
        affine: from voxels to the axes of the file's space, (4, 4).
        keys: key/value pairs of the header, such as Segment0_Name.
        fields: other fields of the header than those of the image, with _ for a blank; None leaves one out.
    """
    more = values.ndim - 3
    vectors = ["({})".format(",".join(map(repr, vector.tolist()))) for vector in affine[:3].T]
    header: dict[str, str | None] = {
        "type": {"float32": "float", "float64": "double"}.get(values.dtype.name, values.dtype.name),
        "dimension": str(values.ndim),
        "space": "left-posterior-superior",
        "sizes": " ".join(map(str, values.shape)),
        "space directions": " ".join(["none"] * more + vectors[:3]),
        "kinds": " ".join(["list"] * more + ["domain"] * 3),
        "endian": "little",
        "encoding": "gzip",
        "space origin": vectors[3],
    }
    header |= {name.replace("_", " "): value for name, value in fields.items()}
    lines = [f"{name}: {value}" for name, value in header.items() if value is not None]
    lines += [f"{name}:={value}" for name, value in keys.items()]
    body = values.tobytes(order="F")
    body = gzip.compress(body, 1) if header["encoding"] == "gzip" else body
    path.write_bytes("\n".join(["NRRD0004", *lines, "", ""]).encode() + body)
    return path


def write_seg_nrrd(path: Path, space: str = "left-posterior-superior") -> Path:
    """The same as a segmentation of 3D Slicer: two layers, each bone a segment with a name."""
    values, affine = labels()
    own = sorted(set(np.unique(values).tolist()) - {0})
    layers = np.stack([np.where(values == own[0], 1, 0), np.where(values == own[0], 0, values)]).astype(np.uint8)
    keys = {}
    for number, value in enumerate(own):
        keys[f"Segment{number}_Name"] = NAMES[value]
        keys[f"Segment{number}_LabelValue"] = str(1 if number == 0 else value)
        keys[f"Segment{number}_Layer"] = str(int(number > 0))
    signs = [-1.0, -1.0, 1.0, 1.0] if space.startswith("right") else np.ones(4)
    return write_nrrd(path, layers, np.diag(signs) @ affine, keys, space=space)

"""Makes of a case what a segmentation of its CT would be: a label map, a folder of masks, a mask of the body.

Usage: python scripts/voxelise_case.py CASE OUT [--spacing 1.5 1.5 1.5] [--turned 0 0 0] [--mirrored]

Writes OUT/labels.nii.gz, OUT/masks/vertebrae_T8.nii.gz and so on (with a body.nii.gz), and OUT/body.nii.gz.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import tyro
from scipy.spatial.transform import Rotation
from trunks import read_trunk

from warp_trunk import Surface
from warp_trunk.geometry.distance_field import Grid, SurfaceDistance
from warp_trunk.preparation.label_maps.sources import TABLES

_ROOM = 4
"""Voxels of air around all."""


def grid_around(
    surface: Surface, spacing: tuple[float, float, float], turn: np.ndarray
) -> tuple[np.ndarray, tuple]:
    """A grid that holds a surface.

    Args:
        surface: what is to be inside [mm].
        spacing: of the voxels along the axes of the grid [mm].
        turn: orthonormal columns, the directions of the grid's axes in LPS; its determinant may be -1.

    Returns:
        Affine from voxels to LPS (4, 4), and how many voxels there are along each axis.
    """
    axes = turn * np.array(spacing)
    voxels = surface.vertices @ np.linalg.inv(axes).T
    low = np.floor(voxels.min(axis=0)) - _ROOM
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = axes, axes @ low
    return affine, tuple((np.ceil(voxels.max(axis=0)) + _ROOM + 1 - low).astype(int).tolist())


def voxelise(surface: Surface, affine: np.ndarray, shape: tuple[int, int, int]) -> tuple[tuple, np.ndarray]:
    """The block of the grid in which a closed surface lies, and which of its voxels have their centre inside
    it."""
    vertices = (surface.vertices - affine[:3, 3]) @ np.linalg.inv(affine[:3, :3]).T
    faces = surface.faces if np.linalg.det(affine[:3, :3]) > 0.0 else surface.faces[:, ::-1].copy()
    distance = SurfaceDistance(Surface(vertices, faces))
    grid = Grid(np.zeros(3), 1.0, shape)
    box = grid.box(vertices.min(axis=0) - 2.0, vertices.max(axis=0) + 2.0)
    wanted = np.ones([part.stop - part.start for part in box], dtype=bool)
    return box, distance.on_grid(grid, box, wanted, 1.5) < 0.0


def label_map(
    surfaces: Iterable[tuple[int, Surface]], affine: np.ndarray, shape: tuple[int, int, int]
) -> np.ndarray:
    """Surfaces with their labels; where two overlap, the first has the voxel. uint8."""
    labels = np.zeros(shape, dtype=np.uint8)
    for value, surface in surfaces:
        box, inside = voxelise(surface, affine, shape)
        labels[box][inside & (labels[box] == 0)] = value
    return labels


def write_labels(
    path: Path, labels: np.ndarray, affine: np.ndarray, names: Mapping[int, str] | None = None
) -> None:
    """A NIfTI, with the names of its labels in the extension that TotalSegmentator writes.

    Args:
        path: .nii or .nii.gz.
        labels: uint8, (i, j, k).
        affine: from voxels to LPS [mm].
        names: by label; none when left out.
    """
    import nibabel
    from nibabel.nifti1 import Nifti1Extension

    ras = np.diag([-1.0, -1.0, 1.0, 1.0]) @ affine
    image = nibabel.Nifti1Image(labels, ras)
    image.header.set_xyzt_units("mm")
    if names:
        table = "".join(
            f'<Label Key="{value}" Alpha="1"><![CDATA[{name}]]></Label>\n' for value, name in names.items()
        )
        xml = (
            '<?xml version="1.0" encoding="UTF-8"?> <CaretExtension><VolumeInformation Index="0"><LabelTable>\n'
            f"{table}</LabelTable><VolumeType><![CDATA[Label]]></VolumeType></VolumeInformation></CaretExtension>"
        )
        image.header.extensions.append(Nifti1Extension(0, xml.encode()))
    nibabel.save(image, path)


def total_segmentator_name(name: str) -> str:
    """The name of a bone of a case in TotalSegmentator."""
    parts = name.split("_")
    if parts[0] == "rib":
        return f"rib_{parts[1]}_{int(parts[2])}"
    if parts[:2] == ["costal", "cartilage"]:
        return "costal_cartilages"
    if parts[0] == "clavicle":
        return f"clavicula_{parts[1]}"
    return name if name[0] not in "CTL" or len(name) > 3 else f"vertebrae_{name}"


Triple = tuple[float, float, float]


def main(
    case: tyro.conf.Positional[Path],
    out: tyro.conf.Positional[Path],
    spacing: Triple = (1.5, 1.5, 1.5),
    turned: Triple = (0.0, 0.0, 0.0),
    mirrored: bool = False,
) -> None:
    """Writes the files.

    Args:
        case: the case folder.
        out: where to write.
        spacing: of the voxels [mm].
        turned: about x, y, z [degrees].
        mirrored: the first axis runs to the patient's right.
    """
    (out / "masks").mkdir(parents=True, exist_ok=True)
    skin, bones = read_trunk(case)
    turn = Rotation.from_euler("xyz", turned, degrees=True).as_matrix()
    turn = turn @ np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0])
    affine, shape = grid_around(skin, spacing, turn)
    numbers = {name: number for number, name in TABLES["totalsegmentator-v2"].items()}
    surfaces = [(numbers[total_segmentator_name(name)], bone) for name, bone in bones.items()]
    labels, present = label_map(surfaces, affine, shape), dict(surfaces)
    names = TABLES["totalsegmentator-v2"]
    write_labels(out / "labels.nii.gz", labels, affine, names)
    for number in present:
        mask = (labels == number).astype(np.uint8)
        write_labels(out / "masks" / f"{names[number]}.nii.gz", mask, affine)
    box, inside = voxelise(skin, affine, shape)
    body = np.zeros(shape, dtype=np.uint8)
    body[box] = inside
    for folder in (out, out / "masks"):
        write_labels(folder / "body.nii.gz", body, affine)
    print(f"{len(present)} labels on {' x '.join(map(str, shape))} voxels written to {out}")


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)

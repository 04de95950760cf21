"""Makes of a case what a segmentation of its CT would be: a label map, a folder of masks, a mask of the body.

Usage: python scripts/voxelise_case.py CASE OUT [--spacing 1.5 1.5 1.5] [--turned 0 0 0] [--mirrored]

Writes OUT/labels.nii.gz, OUT/masks/vertebrae_T8.nii.gz and so on (with a body.nii.gz), and OUT/body.nii.gz.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from label_maps.voxelise import grid_around, label_map, theirs, voxelise, write_labels
from scipy.spatial.transform import Rotation

from warp_trunk import Surface, read_surface
from warp_trunk.io.surface_files import surface_files
from warp_trunk.preparation.label_maps.names import TABLES


def main() -> None:
    """Writes the files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--spacing", type=float, nargs=3, default=(1.5, 1.5, 1.5), help="of the voxels [mm]")
    parser.add_argument("--turned", type=float, nargs=3, default=(0.0, 0.0, 0.0), help="about x, y, z [degrees]")
    parser.add_argument("--mirrored", action="store_true", help="the first axis runs to the patient's right")
    given = parser.parse_args()
    (given.out / "masks").mkdir(parents=True, exist_ok=True)
    skin = read_surface(given.case / "skin.ply")
    bones = {name: read_surface(path) for name, path in surface_files(given.case / "bones").items()}
    turn = Rotation.from_euler("xyz", given.turned, degrees=True).as_matrix()
    turn = turn @ np.diag([-1.0 if given.mirrored else 1.0, 1.0, 1.0])
    a, b, c = given.spacing
    affine, shape = grid_around(skin, (a, b, c), turn)
    numbers = {name: number for number, name in TABLES["totalsegmentator-v2"].items()}
    surfaces: dict[int, Surface] = {}
    for name, bone in bones.items():
        number = numbers[theirs(name)]
        surfaces[number] = together(surfaces[number], bone) if number in surfaces else bone
    labels = label_map(surfaces, affine, shape)
    names = TABLES["totalsegmentator-v2"]
    write_labels(given.out / "labels.nii.gz", labels, affine, names)
    for number in surfaces:
        write_labels(given.out / "masks" / f"{names[number]}.nii.gz", (labels == number).astype(np.uint8), affine)
    box, inside = voxelise(skin, affine, shape)
    body = np.zeros(shape, dtype=np.uint8)
    body[box] = inside
    for folder in (given.out, given.out / "masks"):
        write_labels(folder / "body.nii.gz", body, affine)
    print(f"{len(surfaces)} labels on {' x '.join(map(str, shape))} voxels written to {given.out}")


def together(one: Surface, other: Surface) -> Surface:
    """Two surfaces with one label, as all costal cartilages have."""
    faces = np.vstack([one.faces, other.faces + len(one.vertices)])
    return Surface(np.vstack([one.vertices, other.vertices]), faces)


if __name__ == "__main__":
    main()

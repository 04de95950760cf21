"""Label maps of a spine of blocks, to a case; a large one within its memory."""

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from voxelise_case import total_segmentator_name, write_labels

from support.blocks import known_landmarks
from support.dicom_seg import write_segmentation
from support.label_maps import NAMES, NUMBERS, body, bones, labels, write_map, write_masks, write_seg_nrrd
from support.shown import check_shown
from warp_trunk.case import read_case, write_case
from warp_trunk.cli import main
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface_checks import check_solid
from warp_trunk.io.surface_files import write_surface
from warp_trunk.preparation.label_maps import Imported, ImportOptions, import_case, read_source
from warp_trunk.preparation.label_maps.mask import Mask, depth
from warp_trunk.preparation.label_maps.segmentation_checks import doubts_of_extents
from warp_trunk.preparation.label_maps.sources import read_body

QUICK = ImportOptions(edge_length=16.0)


UPPER = 230.0
"""Where masks of fat and muscle begin [mm]."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Imported:
    """Of an image that ends in T5, with two labels of a few voxels, and fat and muscle of its upper part alone.

    The fat is a shell of 10 mm.
    """
    values, affine = labels()
    values = values[:, :, : int(np.mean(np.nonzero(values == NUMBERS["vertebrae_T5"])[2]))].copy()
    values[0, 0, :1], values[0, 2, :8] = NUMBERS["rib_right_12"], NUMBERS["rib_left_12"]
    folder = tmp_path_factory.mktemp("map")
    write_labels(folder / "labels.nii.gz", values, affine, NAMES)
    write_labels(folder / "body.nii.gz", *body())
    outside = read_body(folder / "body.nii.gz")
    outline = depth(outside.inside, outside.spacing)
    upper = outside.affine[2, 3] + outside.spacing[2] * np.arange(outside.inside.shape[2]) > UPPER
    fat = replace(outside, inside=(outline > 2.0) & (outline < 12.0) & upper)
    tissue = {"subcutaneous_fat": fat, "skeletal_muscle": replace(outside, inside=(outline >= 12.0) & upper)}
    return import_case(read_source(folder / "labels.nii.gz"), outside, "a", QUICK, tissue=tissue)


def test_the_case_that_is_written_is_as_accepted(made, tmp_path):
    """Header, bones, landmarks, notes and what was not found."""
    write_case(tmp_path / "a", made.case)
    read, fat = read_case(tmp_path / "a"), made.fat
    assert fat is not None
    check_shown(
        "imported_case",
        [
            (tmp_path / "a" / "case.toml").read_text(encoding="utf-8"),
            f"bones {' '.join(read.bones)}",
            f"landmarks {' '.join(read.landmarks_before.names)}",
            *(f"{name}: {why}" for name, why in made.landmarks.unsure.items()),
            *made.notes,
        ],
    )
    assert 6.0 < np.median(fat) < 11.0


def test_bones_and_landmarks_are_those_of_the_true_ones(made):
    for name, bone in made.case.bones.items():
        off = np.abs(SurfaceDistance(bones()[name]).at(bone.vertices))
        if name != "T5":  # of which there is a part
            assert off.mean() < 0.45, name  # edges of blocks are rounded
            assert abs(made.shapes[name].change) < 0.01
    true, marks = known_landmarks(), made.case.landmarks_before
    for name in marks.names[:-2]:  # the fronts of these hip bones are flat, so that spines are anywhere on them
        off = np.abs(marks.point(name) - true.point(name))
        assert off[[0, 2]].max() < 0.7, name
        assert off[1] < (8.0 if "pedicle" in name else 0.7), name


def test_the_skin_is_closed_and_where_the_body_is(made):
    skin = made.case.skin
    check_solid(skin, "skin")
    x, y, z = skin.vertices.T
    side = np.abs(z - 190.0) < 150.0
    off = np.hypot(x / 135.0, y / 105.0)[side] - 1.0
    assert np.abs(off).mean() * 120.0 < 0.8
    assert np.abs(skin.vertices[:, 2]).max() < 412.0
    lowest = min(made.case.bones[hip].vertices[:, 2].min() for hip in ("hip_left", "hip_right"))
    assert z.min() == pytest.approx(lowest - 25.0, abs=0.1)
    assert np.sum(z < z.min() + 0.2) > 100  # flat
    assert [plane.unit[2] for plane in made.cuts] == [-1.0]


def write_dicom(folder: Path) -> Path:
    values, affine = labels()
    names = {number: NAMES[number] for number in np.unique(values).tolist() if number}
    return write_segmentation(folder / "a.dcm", values[None], affine, names)


FORMS: dict[str, Callable[[Path], Path]] = {
    "a map": lambda folder: write_map(folder)[0],
    "masks": lambda folder: write_masks(folder / "masks"),
    "RAS": lambda folder: write_seg_nrrd(folder / "a.seg.nrrd", "right-anterior-superior"),
    "DICOM": write_dicom,
}


@pytest.mark.parametrize(
    "form", [pytest.param(form, marks=pytest.mark.slow if form == "DICOM" else ()) for form in FORMS]
)
def test_every_form_of_a_label_map_gives_the_same_bones(tmp_path, form):
    source, (values, affine) = read_source(FORMS[form](tmp_path)), labels()
    own_body = form == "masks"
    assert (source.ignored, source.empty) == ((["spleen"], ["T9"]) if own_body else ([], []))
    assert source.masks.keys() - {"skin"} == set(bones())
    for name in bones():
        wanted = np.argwhere(values == NUMBERS[total_segmentator_name(name)]) @ affine[:3, :3].T + affine[:3, 3]
        points = source.masks[name].points()
        assert len(points) == len(wanted)
        for ours, true in zip(
            (points.min(0), points.max(0), points.mean(0)),
            (wanted.min(0), wanted.max(0), wanted.mean(0)),
            strict=True,
        ):
            np.testing.assert_allclose(ours, true, atol=1e-3)


def test_surfaces_by_names_of_others(tmp_path):
    names = {
        "T5": "fifth thoracic vertebra",
        "T6": "T6 vertebra",
        "T7": "vertebrae_T7",
        "hip_left": "Left hip bone",
    }
    for name, bone in (bones() | {"body": bones()["T5"], "spleen": bones()["T5"]}).items():
        write_surface(tmp_path / f"{names.get(name, name)}.stl", bone)
    source = read_source(tmp_path)
    assert source.surfaces.keys() == {*bones(), "skin"}
    for name, bone in bones().items():
        np.testing.assert_allclose(source.surfaces[name].vertices.mean(0), bone.vertices.mean(0), atol=1e-3)


@pytest.mark.parametrize(
    ("grow", "said"),
    [(1.0, None), (1.02, "has voxels of 1.0200 times the size of the labels'"), (0.5, "does not hold")],
)
def test_a_body_of_another_header_is_named(grow, said):
    """The body on the grid of the labels, its header enlarged: the array is the same."""
    shape = (40, 40, 40)
    bone = Mask(np.ones((8, 8, 8), dtype=bool), (24, 24, 24), np.eye(4), shape)
    whole = Mask(np.ones(shape, dtype=bool), (0, 0, 0), np.diag([grow] * 3 + [1.0]), shape)
    doubts = doubts_of_extents({"the body": whole}, {"T5": bone})
    assert bool(doubts) == (said is not None)
    assert said is None or said in " ".join(doubts)


def test_the_first_sacral_vertebra_is_a_part_of_the_sacrum(tmp_path):
    """Of one map, and of masks on grids that differ by rounding."""
    values, affine = labels()
    shifted = affine.copy()
    shifted[:3, 3] += 0.005
    (tmp_path / "m").mkdir()
    for name, number, own in (("sacrum", "vertebrae_T5", affine), ("vertebrae_S1", "vertebrae_T6", shifted)):
        write_labels(tmp_path / "m" / f"{name}.nii.gz", (values == NUMBERS[number]).astype(np.uint8), own)
    names = {NUMBERS["vertebrae_T5"]: "sacrum", NUMBERS["vertebrae_T6"]: "vertebrae_S1"}
    write_labels(tmp_path / "a.nii.gz", np.where(np.isin(values, list(names)), values, 0), affine, names)
    for source in ("m", "a.nii.gz"):
        points = read_source(tmp_path / source).masks["sacrum"].points()
        assert len(points) == np.isin(values, list(names)).sum()


def test_a_real_ct_is_imported_as_far_as_it_reaches(tmp_path, capsys):
    """The label map of a public CT of an abdomen: bones from T11 down, its own skin, and what is cut off."""
    folder = os.environ.get("WARP_TRUNK_LABEL_MAPS")
    if not folder:
        pytest.skip("WARP_TRUNK_LABEL_MAPS names no folder with example_ct.nii.gz and its segmentation")
    segmentation, ct = (Path(folder) / f"example_{n}.nii.gz" for n in ("seg_fast_force_split", "ct"))
    assert main(["import", str(segmentation), "--ct", str(ct), "--out", str(tmp_path / "a")]) == 3
    said = capsys.readouterr().err
    for part in ("image ends in T11, T12", "cut off by the left border", "T11: no landmarks"):
        assert part in said
    case = read_case(tmp_path / "a")
    assert {"L1", "L5", "sacrum", "hip_left", "rib_right_11"} <= case.bones.keys()
    assert len(case.landmarks_before.vertebrae()) == 5
    check_solid(case.skin, "skin")


SHAPE = (512, 512, 300)
WHOLE = 900
"""Slices of a large map; what is read grows by the slice, so that a third of them shows it."""
MOST_BYTES = 2e9
# Not ru_maxrss: a process inherits that of the one that began it.
READ = """
import sys
from pathlib import Path
from warp_trunk.preparation.label_maps import read_source
from warp_trunk.preparation.label_maps.sources import read_body
def most():
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return 1024 * int(line.split()[1])
started = most()
found = read_source(Path(sys.argv[1]))
body = read_body(Path(sys.argv[1]))
print(len(found.masks), body.inside.shape, started, most() - started)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_large_map_is_read_within_two_gigabytes(tmp_path):
    values = np.zeros(SHAPE, dtype=np.uint8, order="F")
    for place, name in enumerate(("vertebrae_T5", "vertebrae_T6", "sternum", "hip_left", "hip_right")):
        low = 40 + 90 * place
        values[low : low + 60, 100:400, low // 3 : low // 3 + 100] = NUMBERS[name]
    values[0, 0, 0] = values[-1, -1, -1] = NUMBERS["sacrum"]  # as large as a box can be
    write_labels(tmp_path / "a.nii", values, np.diag([0.8, 0.8, 0.75, 1.0]), NAMES)
    del values
    run = subprocess.run(
        [sys.executable, "-c", READ, str(tmp_path / "a.nii")], capture_output=True, encoding="utf-8"
    )
    assert run.returncode == 0, run.stderr[-500:]
    masks, *shape, started, read = run.stdout.replace("(", "").replace(")", "").replace(",", "").split()
    assert (int(masks), tuple(map(int, shape))) == (6, SHAPE)
    assert float(started) + float(read) * WHOLE / SHAPE[2] < MOST_BYTES

"""Label maps of a spine of blocks, to a case; a large one within its memory."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from voxelise_case import write_labels

from support.dicom_seg import write_segmentation
from support.label_maps import LEVELS, NAMES, NUMBERS, bones, labels, write_map, write_masks, write_seg_nrrd
from warp_trunk import find_landmarks
from warp_trunk.case import read_case
from warp_trunk.case.landmarks import VERTEBRA_POINTS
from warp_trunk.cli import main
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface_checks import check_solid
from warp_trunk.io.surface_files import write_surface
from warp_trunk.preparation.label_maps import Imported, ImportOptions, import_case, read_source
from warp_trunk.preparation.label_maps.mask import depth
from warp_trunk.preparation.label_maps.segmentation_checks import doubts_of_extents
from warp_trunk.preparation.label_maps.sources import read_body

QUICK = ImportOptions(edge_length=12.0)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return write_map(tmp_path_factory.mktemp("map"))


@pytest.fixture(scope="module")
def made(files: tuple[Path, Path]) -> Imported:
    return import_case(read_source(files[0]), read_body(files[1]), "a", QUICK)


def test_bones_have_their_names_and_places(made):
    assert set(made.case.bones) == set(bones())
    for name, bone in bones().items():
        off = np.abs(SurfaceDistance(bone).at(made.case.bones[name].vertices))
        assert off.mean() < 0.45, name  # edges of blocks are rounded
        assert abs(made.shapes[name].change) < 0.01


def test_landmarks_are_those_of_the_true_bones(made):
    true = find_landmarks(bones()).complete()
    marks = made.case.landmarks_before
    assert set(marks.names) == set(true.names)
    off = [np.linalg.norm(marks.point(name) - true.point(name)) for name in true.names]
    assert np.mean(off[:-2]) < 0.7  # the fronts of these hip bones are flat, so that spines are anywhere on them
    assert len(made.landmarks.vertebrae) == len(LEVELS)
    assert made.case.posture == "supine"


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


SAME_SOURCES: dict[str, Callable[[Path], Path]] = {
    "masks": lambda folder: write_masks(folder / "masks"),
    "LPS": lambda folder: write_seg_nrrd(folder / "a.seg.nrrd"),
    "RAS": lambda folder: write_seg_nrrd(folder / "a.seg.nrrd", "right-anterior-superior"),
}


@pytest.mark.slow
@pytest.mark.parametrize("form", SAME_SOURCES)
def test_every_form_of_a_label_map_gives_the_same_bones(made, files, tmp_path, form):
    source = read_source(SAME_SOURCES[form](tmp_path))
    own_body = form == "masks"
    assert (source.ignored, source.empty) == ((["spleen"], ["T9"]) if own_body else ([], []))
    again = import_case(source, None if own_body else read_body(files[1]), "a", QUICK)
    assert list(again.case.bones) == list(made.case.bones)
    for name, bone in made.case.bones.items():
        np.testing.assert_allclose(again.case.bones[name].vertices, bone.vertices, atol=1e-4)
    np.testing.assert_allclose(again.case.skin.vertices, made.case.skin.vertices, atol=1e-4)
    np.testing.assert_allclose(again.case.landmarks_before.points, made.case.landmarks_before.points, atol=1e-3)


@pytest.mark.slow
def test_a_dicom_segmentation_gives_the_same_case(made, files, tmp_path):
    values, affine = labels()
    names = {number: NAMES[number] for number in np.unique(values).tolist() if number}
    path = write_segmentation(tmp_path / "a.dcm", values[None], affine, names)
    again = import_case(read_source(path), read_body(files[1]), "a", QUICK)
    for name, bone in made.case.bones.items():  # the order of its slices may be the other one
        assert np.abs(SurfaceDistance(bone).at(again.case.bones[name].vertices)).max() < 0.01
    assert again.case.landmarks_before.names == made.case.landmarks_before.names
    np.testing.assert_allclose(again.case.landmarks_before.points, made.case.landmarks_before.points, atol=0.1)


@pytest.mark.slow
def test_surfaces_by_names_of_others(made, tmp_path):
    names = {
        "T5": "fifth thoracic vertebra",
        "T6": "T6 vertebra",
        "T7": "vertebrae_T7",
        "hip_left": "Left hip bone",
    }
    for name, bone in bones().items():
        write_surface(tmp_path / f"{names.get(name, name)}.stl", bone)
    write_surface(tmp_path / "body.ply", made.case.skin)
    write_surface(tmp_path / "spleen.ply", made.case.skin)
    again = import_case(read_source(tmp_path), None, "a", QUICK)
    assert set(again.case.bones) == set(bones())
    assert len(again.landmarks.vertebrae) == len(LEVELS)


@pytest.mark.slow
def test_a_vertebra_that_the_image_ends_in_has_no_landmarks(files, tmp_path):
    values, affine = labels()
    inside = np.argwhere(values == NUMBERS["vertebrae_T5"])
    height = (inside[:, 2].min() + inside[:, 2].max()) // 2
    write_labels(tmp_path / "a.nii.gz", values[:, :, :height], affine)
    made = import_case(read_source(tmp_path / "a.nii.gz", "totalsegmentator-v2"), read_body(files[1]), "a", QUICK)
    assert made.landmarks.unsure == {"T5": "the image ends in it, so that only a part is there"}
    assert "T5" in made.case.bones
    assert len(made.case.landmarks_before.names) == 3 * len(VERTEBRA_POINTS) + 2


def changed_map(
    tmp_path: Path, change: Callable[[np.ndarray], np.ndarray], affine: np.ndarray | None = None
) -> Path:
    values, own = labels()
    write_labels(tmp_path / "a.nii.gz", change(values.copy()), own if affine is None else affine, NAMES)
    return tmp_path / "a.nii.gz"


@pytest.mark.slow
def test_stray_labels_are_left_out_with_a_note(files, tmp_path):
    counts = {"rib_right_12": 1, "rib_left_12": 8}

    def stray(values: np.ndarray) -> np.ndarray:
        for row, (name, count) in enumerate(counts.items()):
            values[0, 2 * row, :count] = NUMBERS[name]
        return values

    made = import_case(read_source(changed_map(tmp_path, stray)), read_body(files[1]), "a", QUICK)
    assert set(made.case.bones) == set(bones())
    for name, count in counts.items():
        assert f"{name}: left out, as it has {count} voxels" in " ".join(made.case.notes)


@pytest.mark.parametrize(
    ("grow", "said"),
    [(1.0, None), (1.02, "has voxels of 1.0200 times the size of the labels'"), (0.5, "does not hold")],
)
def test_a_body_of_another_header_is_named(grow, said, tmp_path):
    """The body on the grid of the labels, its header enlarged: the array is the same."""
    values, affine = labels()
    write_labels(tmp_path / "b.nii.gz", np.ones_like(values), affine @ np.diag([grow] * 3 + [1.0]))
    made = doubts_of_extents({"the body": read_body(tmp_path / "b.nii.gz")}, read_source(
        changed_map(tmp_path, lambda v: v)).masks)  # fmt: skip
    assert bool(made) == (said is not None)
    assert said is None or said in " ".join(made)


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


@pytest.mark.slow
def test_masks_of_half_of_the_body_say_where_they_do_not_reach(made, files, tmp_path):
    """Fat and muscle above the middle of the body alone; the fat is a shell of 10 mm."""
    body_mask = read_body(files[1])
    outline = depth(body_mask.inside, body_mask.spacing)
    upper = np.arange(body_mask.inside.shape[2]) > body_mask.inside.shape[2] // 2
    fat = replace(body_mask, inside=(outline > 2.0) & (outline < 12.0) & upper)
    muscle = replace(body_mask, inside=(outline >= 12.0) & upper)
    tissue = {"subcutaneous_fat": fat, "skeletal_muscle": muscle}
    half = import_case(read_source(files[0]), body_mask, "a", QUICK, tissue=tissue)
    assert [note for note in half.notes if re.search(r"reach \d\d % of the skin; .* not measured there", note)]
    assert half.fat is not None
    assert 6.0 < np.median(half.fat) < 11.0


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

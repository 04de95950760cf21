"""A case folder is written and read back; names of its files that are nearly those of bones."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.asserting import not_none
from support.small_case import mapped, small_case
from warp_trunk.case import Axes, Case, read_case, read_checked_case, write_case
from warp_trunk.case.anatomy import check_bone_names
from warp_trunk.case.case import Study
from warp_trunk.case.fingerprint import difference, fingerprint_of
from warp_trunk.case.landmarks import Landmarks, write_landmarks
from warp_trunk.case.layers import Layers
from warp_trunk.case.points import Points
from warp_trunk.case.rib_coupling import RibCoupling
from warp_trunk.case.uncertainty import Invented, Uncertainty
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import slivers
from warp_trunk.io.file_names import name_of
from warp_trunk.results.result import prepare_folder


def assert_equal(first: Case, other: Case) -> None:
    assert (first.name, first.tissue, list(first.bones)) == (other.name, other.tissue, list(other.bones))
    for a, b in [(first.skin, other.skin), *((first.bones[n], other.bones[n]) for n in first.bones)]:
        np.testing.assert_array_equal(a.vertices, b.vertices)
        np.testing.assert_array_equal(a.faces, b.faces)
    for key in ("landmarks_before", "planned_landmarks"):
        a, b = getattr(first, key), getattr(other, key)
        assert a.names == b.names
        np.testing.assert_array_equal(a.points, b.points)


def test_a_case_that_was_not_written_to_its_end_is_none(tmp_path, monkeypatch):
    """Killed over an earlier case: surfaces of both would be read as one."""
    write_case(tmp_path, small_case())
    opened = Path.open

    def killed(path: Path, *how, **more):
        if path.suffix == ".csv":
            raise KeyboardInterrupt
        return opened(path, *how, **more)

    monkeypatch.setattr(Path, "open", killed)
    with pytest.raises(KeyboardInterrupt):
        write_case(tmp_path, small_case())
    monkeypatch.undo()
    with pytest.raises(InputError, match=r"case\.toml"):
        read_case(tmp_path)


def test_round_trip_keeps_every_bit(tmp_path):
    skin = small_case().skin
    before = small_case().landmarks_before
    some = Landmarks(before.names[:6], before.points[:6] + np.array([3.0, 0.0, 1.0]))
    actual = Surface(skin.vertices / 3.0 * 3.1, skin.faces)
    case = replace(small_case(), actual_skin=actual, bending_left=some)
    write_case(tmp_path, case)
    back = read_case(tmp_path)
    assert_equal(back, case)
    np.testing.assert_array_equal(not_none(back.actual_skin).vertices, actual.vertices)
    left = not_none(back.bending_left)
    assert left.names == some.names
    np.testing.assert_array_equal(left.points, some.points)
    assert back.bending_right is None
    write_case(tmp_path, case)  # over itself


@pytest.mark.parametrize("code", ["RAS", "LAS", "SPL"])
def test_axes_and_units_are_converted_at_the_border(tmp_path, code):
    """Files written in other axes, in metres, come back as the same case; their headers say LPS."""
    case = small_case()
    write_case(tmp_path, mapped(case, Axes(code).matrix.T / 1000.0))
    layers = "[layers]\nskin_thickness = 0.0015\nfat_thickness = 0.004\n"
    (tmp_path / "case.toml").write_text(f'axes = "{code}"\nunits = "m"\n{layers}', encoding="utf-8")
    back, warnings = read_checked_case(tmp_path)
    note = f'{tmp_path / "skin.ply"}: its header says SPACE=LPS; axes = "{code}" of case.toml is used.'
    assert note in warnings
    thick = not_none(back.layers)
    assert (thick.skin_thickness, thick.fat_thickness) == pytest.approx((1.5, 4.0))
    np.testing.assert_allclose(back.skin.vertices, case.skin.vertices, atol=1e-9)
    np.testing.assert_allclose(back.bones["T7"].vertices, case.bones["T7"].vertices, atol=1e-9)
    np.testing.assert_allclose(back.planned_landmarks.points, case.planned_landmarks.points, atol=1e-9)


def test_thin_triangles_are_merged_with_a_note_that_names_the_first(tmp_path: Path) -> None:
    """Two vertices come near to others; what was not measured stays with its place."""
    case = small_case()
    points, unseen = case.skin.vertices.copy(), case.skin.vertices[:, 0] < 0.0
    firsts = np.flatnonzero((points[case.skin.faces][:, :, 2] > 100.0).all(axis=1))[[40, 900]]
    for a, b, _ in case.skin.faces[firsts]:
        points[a] = points[b] + 0.004 * (points[a] - points[b])
    thin = slivers(case.skin.moved(points))
    write_case(tmp_path, replace(case, skin=case.skin.moved(points), unseen=unseen))
    back, warnings = read_checked_case(tmp_path)
    assert warnings[0].startswith(
        f"{tmp_path / 'skin.ply'}: {len(thin)} triangles have an angle of less than 1 degree"
    )
    assert f"the first number {thin[0]} near (" in warnings[0]
    assert len(back.skin.vertices) < len(points)
    np.testing.assert_array_equal(not_none(back.unseen), back.skin.vertices[:, 0] < 0.0)


def test_rows_of_the_second_landmark_file_are_matched_by_name(tmp_path):
    case = small_case()
    write_case(tmp_path, case)
    after = case.planned_landmarks
    write_landmarks(tmp_path / "landmarks_after.csv", Landmarks(after.names[::-1], after.points[::-1]))
    assert_equal(read_case(tmp_path), case)


def test_writing_does_not_mix_two_cases(tmp_path):
    write_case(tmp_path, small_case())
    fewer = {name: bone for name, bone in small_case().bones.items() if name != "T7"}
    with pytest.raises(InputError, match=r"bones/T7\.ply: would be read as part of case"):
        write_case(tmp_path, replace(small_case(), bones=fewer))
    with pytest.raises(InputError, match=r"'\.\./T7' has the character '/', and must be a valid file name"):
        write_case(tmp_path / "other", replace(small_case(), bones={"../T7": small_case().skin}))
    assert not (tmp_path / "other").exists()


def test_a_case_without_a_plan_has_no_landmarks_of_an_earlier_one(tmp_path: Path) -> None:
    write_case(tmp_path, small_case())
    write_case(tmp_path, replace(small_case(), landmarks_after=None))
    assert not (tmp_path / "landmarks_after.csv").exists()
    assert read_case(tmp_path).landmarks_after is None


@pytest.mark.parametrize(
    ("name", "bone"),
    [
        ("t8", "T8"), ("T08", "T8"), ("T_8", "T8"), ("vertebrae_T8", "T8"), ("l5 vertebra", "L5"),
        ("rib_left_1", "rib_left_01"), ("Rib-Right-12", "rib_right_12"), ("left_rib_1", "rib_left_01"),
        ("Sacrum", "sacrum"), ("left hip", "hip_left"), ("HIP_RIGHT", "hip_right"),
        ("Th8", "T8"), ("D8", "T8"), ("T8 copy", "T8"), ("L5_bone", "L5"), ("rib_l_07", "rib_left_07"),
        ("hip_r", "hip_right"), ("pelvis_left", "hip_left"), ("os sacrum", "sacrum"),
    ],
)  # fmt: skip
def test_a_file_called_nearly_as_a_bone_is_named(name, bone):
    with pytest.raises(InputError, match=rf"a case calls this bone {bone}; rename the file to {bone}\.stl"):
        check_bone_names({name: Path(f"bones/{name}.stl")})


def test_other_names_stay():
    names = ("T8", "rib_left_01", "mandible", "sternum_upper", "hip_left_lower", "T7x", "S1", "bone 12", "")
    check_bone_names({name: Path(name) for name in names})


def test_every_field_of_a_case_comes_back_from_its_folder(tmp_path: Path) -> None:
    """`tests/cohort/test_kept.py` sees that the fingerprint has every field."""
    case, marks = small_case(), small_case().landmarks_before
    some = Landmarks(marks.names[:6], marks.points[:6] + 2.0)
    places = np.array([case.skin.vertices[0], case.bones["T7"].vertices[0]])
    whole = replace(
        case,
        name="other",
        posture="supine",
        notes=("The skin was repaired.", "T6 is missing."),
        tissue=replace(case.tissue, density=950.0),
        rib_coupling=RibCoupling(upper=0.6),
        uncertainty=Uncertainty(landmark_error=1.5, cobb=0.2, mesh_rotation=0.3),
        study=Study(patient="P9", pose="bending", months_after=3.0, synthetic=True),
        layers=Layers(skin_thickness=1.5, fat_thickness=4.0),
        unseen=case.skin.vertices[:, 1] < 0.0,
        invented=Invented(),
        bending_left=some,
        bending_right=replace(some, points=some.points + 1.0),
        actual_skin=case.skin.moved(case.skin.vertices * 1.01),
        bones_after={"T7": case.bones["T7"].moved(case.bones["T7"].vertices + 1.0)},
        points=Points(Landmarks(("tip", "bone"), places), {"tip": "bone"}),
    )
    assert difference(fingerprint_of(case), fingerprint_of(whole))
    write_case(tmp_path, whole)
    assert difference(fingerprint_of(whole), fingerprint_of(read_case(tmp_path))) == ""


@pytest.mark.skipif(os.name == "nt" or sys.platform == "darwin", reason="this system has names of text only")
def test_a_folder_whose_name_is_not_utf_8_is_a_case(tmp_path: Path) -> None:
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/p\xe9"))
    write_case(folder, replace(small_case(), name=name_of(folder)))
    assert read_case(folder).name == "p\ufffd"
    (folder / "case.toml").unlink()
    assert read_case(folder).name == "p\ufffd"
    with pytest.raises(InputError, match="is no path in UTF-8, which the viewer's file needs"):
        prepare_folder(folder.with_name(f"{folder.name}_result"))

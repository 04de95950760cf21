"""A back cut from a whole body, fitted again: there the truth is known."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from support.asserting import not_none
from support.shown import check_shown, described
from warp_trunk.bone_motion.rib_cage import ends
from warp_trunk.case import Case, read_case, write_case
from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.checks import check_case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.coarsening import coarsen
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.geometry.surface import Surface, area_vectors, unit
from warp_trunk.geometry.surface_checks import crossings
from warp_trunk.measures.back_rotation import back_surface_rotation
from warp_trunk.preparation.back_scan import fit_back
from warp_trunk.preparation.back_scan.body import StraightBody, posterior_spines
from warp_trunk.preparation.back_scan.scan import cut_back
from warp_trunk.preparation.deformity import SpineCurve, impose
from warp_trunk.preparation.deformity.patient_spine import spine_of_marks
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.spine import cobb_angles
from warp_trunk.spine.spine import asis_axis

ANGLE = np.radians(11.0)
TURNED = np.array([[np.cos(ANGLE), -np.sin(ANGLE), 0.0], [np.sin(ANGLE), np.cos(ANGLE), 0.0], [0.0, 0.0, 1.0]])
SHIFT = np.array([120.0, -900.0, 40.0])


@pytest.fixture(scope="module")
def body():
    """One that is fitted, with a skin coarse enough for a second."""
    skin, bones, marks = straight_trunk()
    skin = coarsen(skin, 15.0, 1.0)
    return StraightBody("phantom", skin, bones, marks, posterior_spines(skin, bones, asis_axis(marks)))


@pytest.fixture(scope="module")
def whole(body):
    """A body 7 % larger than the one that is fitted, with a curve, turned on its feet."""
    larger = body.scaled(1.07)
    skin, bones, marks = impose(larger.skin, larger.bones, larger.landmarks, SpineCurve(cobb=50.0))

    def turned(surface: Surface) -> Surface:
        return Surface(surface.vertices @ TURNED.T + SHIFT, surface.faces)

    return Case(
        name="whole",
        skin=turned(skin),
        bones={name: turned(bone) for name, bone in bones.items()},
        landmarks_before=Landmarks(marks.names, marks.points @ TURNED.T + SHIFT),
    )


@pytest.fixture(scope="module")
def scan(whole):
    """Its back, with an arm beside it and stray points behind."""
    points, spine, markers = cut_back(whole)
    rng = np.random.default_rng(1)
    arm = np.array([340.0, -960.0, 280.0]) + rng.normal(0.0, 6.0, (400, 3))
    stray = np.array([120.0, -500.0, 300.0]) + rng.normal(0.0, 3.0, (30, 3))
    return np.vstack([points, arm, stray]), spine, markers


@pytest.fixture(scope="module")
def fit(scan, body):
    """With a colour that changes with place."""
    shade = 128.0 + 0.2 * (scan[0] - scan[0].mean(axis=0))
    return fit_back(scan[0], scan[1], scan[2], body, colours=np.clip(shade, 0.0, 255.0).astype(np.uint8))


def test_the_skin_is_the_scan_with_its_colours_and_no_step_at_its_rim(fit, scan):
    """All beyond the trunk is left out; where the scan shows nothing, the colour is its median."""
    skin, points = fit.case.skin, scan[0]
    assert fit.distance.mean() < 0.5
    assert np.percentile(fit.distance, 95.0) < 1.5
    assert len(fit.left_out) + len(fit.distance) < len(points)
    far = SurfaceDistance(skin).at(fit.left_out) > 20.0
    assert far.sum() > 100
    assert (~far).sum() < 0.01 * len(fit.distance)
    assert not len(crossings(skin))
    assert fit.case.unseen.sum() == (~fit.seen).sum()
    shade = 128.0 + 0.2 * (skin.vertices - points.mean(axis=0))
    assert np.abs(skin.colours.astype(float) - shade)[fit.seen].max() < 6.0
    away = skin.colours[KDTree(points).query(skin.vertices)[0] > 30.0]
    median = np.median(np.clip(128.0 + 0.2 * (points - points.mean(axis=0)), 0.0, 255.0).astype(np.uint8), axis=0)
    assert (away == median.astype(int)).all()
    facing = unit(area_vectors(skin.vertices, skin.faces))
    edges = np.sort(skin.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    pairs = np.repeat(np.arange(len(skin.faces)), 3)[order].reshape(-1, 2)
    rim = np.logical_xor(*fit.seen[edges[order][::2]].T)
    cosine = np.einsum("ei,ei->e", *facing[pairs].swapaxes(0, 1))
    fold = np.degrees(np.arccos(np.clip(cosine[rim], -1.0, 1.0)))
    assert len(fold) > 50
    assert np.percentile(fold, 95.0) < 20.0
    assert fold.max() < 75.0


def test_the_rotation_of_the_back_and_the_curve_are_those_of_the_whole_body(fit, whole):
    """At the same heights: levels are not known of a line."""
    marks = fit.case.landmarks_before
    truth, of_fit = (back_surface_rotation(skin, marks) for skin in (whole.skin, fit.case.skin))
    for level in VERTEBRAE[5:15]:
        tangent, other = not_none(of_fit[level]), not_none(truth[level])
        assert tangent.angle == pytest.approx(other.angle, abs=1.0), level
    main = max(cobb_angles(marks), key=lambda curve: curve.angle)
    assert main.angle == pytest.approx(50.0, abs=3.0)
    assert (main.upper, main.lower) == ("T5", "T12")
    assert fit.scale == pytest.approx(1.07, abs=0.02)
    assert np.linalg.norm(marks.points - whole.landmarks_before.points, axis=1).mean() < 15.0


def test_bones_lie_inside_and_vertebrae_are_rigid_with_ribs_on_them(fit, body):
    assert check_case(fit.case) == ()
    straight, bones = body.scaled(fit.scale).bones, fit.case.bones
    distance = SurfaceDistance(fit.case.skin)
    for name, bone in bones.items():
        assert distance.at(bone.vertices).max() < -2.0, name
        if name in VERTEBRAE:
            spread = [np.linalg.norm(b.vertices - b.vertices.mean(axis=0)) for b in (straight[name], bone)]
            size = spread[1] / spread[0]
            assert 0.79 < size < 1.16, name
            same = size * straight[name].vertices
            assert np.allclose(fit_rigid(same, bone.vertices).apply(same), bone.vertices, atol=1e-6), name
        if name.startswith("rib_"):
            level = bones[f"T{int(name[-2:])}"]
            head = ends(bone, level)[0]
            assert np.abs(SurfaceDistance(level).at(head[None]))[0] < 7.0, name


def test_the_case_that_is_written_is_as_accepted(fit, tmp_path):
    write_case(tmp_path / "case", fit.case)
    read = read_case(tmp_path / "case")
    assert np.array_equal(not_none(read.unseen), ~fit.seen)
    header = (tmp_path / "case" / "case.toml").read_text(encoding="utf-8")
    size = f"{fit.body}, scale {described(fit.scale)}, invented {described(fit.invented)}"
    check_shown("fitted_back", [header, f"bones {' '.join(read.bones)}", size])


@pytest.mark.slow
def test_landmarks_of_films_leave_less_to_invent(scan, whole):
    fit = fit_back(scan[0], spine_of_marks(whole.landmarks_before), scan[2])
    marks = fit.case.landmarks_before
    off = np.linalg.norm(marks.points - whole.landmarks_before.points, axis=1)
    assert off[["asis" not in name for name in marks.names]].mean() < 2.0
    assert not_none(fit.case.invented).vertebral_turn < 6.0

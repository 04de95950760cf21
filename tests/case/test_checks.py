"""Checks of a case: units, axes, names, skins, and landmarks by their order, shapes, frame and places."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.asserting import not_none, refuses
from support.known_spine import LEVELS, before_and_after, exchanged, shifted, with_errors
from support.small_case import mapped, palpated, small_case
from warp_trunk.case import Case, read_case, write_case
from warp_trunk.case.checks import CaseSource, check_case
from warp_trunk.case.landmark_checks import align_pelvis, check_frame, check_motion, check_order, check_shapes
from warp_trunk.case.landmarks import VERTEBRA_POINTS, Landmarks
from warp_trunk.case.skin_checks import check_second_skin
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface


def refused(case: Case, rule: str, source: CaseSource | None = None) -> None:
    with pytest.raises(InputError, match=rule) as error:
        check_case(case, source=source)
    assert "\n" not in str(error.value)


def with_landmarks(change) -> Case:
    """Both sets of landmarks changed alike: `change` takes and gives a dict of points by name."""
    sets = []
    for landmarks in (small_case().landmarks_before, small_case().planned_landmarks):
        points = change(dict(zip(landmarks.names, landmarks.points.copy(), strict=True)))
        sets.append(Landmarks(tuple(points), np.array(list(points.values())).reshape(-1, 3)))
    return replace(small_case(), landmarks_before=sets[0], landmarks_after=sets[1])


def without(prefix: str):
    return lambda points: {name: p for name, p in points.items() if not name.startswith(prefix)}


def moved(name: str, by) -> Case:
    return with_landmarks(lambda points: points | {name: points[name] + by})


def scaled(key: str, by: float) -> Case:
    """The case with a skin in another unit."""
    skin = small_case().skin
    return replace(small_case(), **{key: Surface(skin.vertices * by, skin.faces)})


def hips_exchanged(case: Case) -> Case:
    bones = {**case.bones, "hip_left": case.bones["hip_right"], "hip_right": case.bones["hip_left"]}
    return replace(case, bones=bones)


FEW_LANDMARKS = ("T7_superior_endplate", "asis_left", "asis_right")
UNITS = (
    "the trunk is {} mm tall, and must be 250 to 900 mm; the bones are in mm, and this file seems to be in {}: "
)
FAR = Landmarks(small_case().landmarks_before.names, small_case().planned_landmarks.points + 120.0)
REFUSED = [
    (with_landmarks(lambda p: {n: p[n] for n in FEW_LANDMARKS}), "at least 4 landmarks are needed, there are 3"),
    (with_landmarks(lambda p: {n: x * [1.0, 0.0, 1.0] for n, x in p.items()}),
     "must not lie in one plane, these are .* mm from one"),
    (with_landmarks(without("asis_right")), "'asis_right' is missing; rotations are measured against"),
    (with_landmarks(lambda p: without("L3")(without("T12")(p))), "at least 2 vertebrae need landmarks"),
    (with_landmarks(without("T12_left_pedicle_superior")),
     r"'T12_left_pedicle_superior' is missing; a vertebra with landmarks needs all six \(T12 has 5\)"),
    (moved("T7_superior_endplate", [0.0, 0.0, 15.5]),
     r"landmarks_before: 'T7_superior_endplate' is 15\.4 mm from T7, 15 mm is allowed"),
    (replace(small_case(), landmarks_after=FAR), r"landmarks_after: '.*' moves 2\d\d\.\d mm, 150 mm is allowed"),
    (scaled("skin", 0.1), f"skin: {UNITS.format('57.5', 'cm')}write it in mm"),
    (scaled("skin", 1.0 / 25.4), f"skin: {UNITS.format('22.64', 'in')}write it in mm"),
    (scaled("actual_skin", 1e-3), f"actual_skin: {UNITS.format('0.575', 'm')}write it in mm"),
    (scaled("skin", 1.7), "977.5 mm tall.*--cut-above Z --cut-below Z"),
    (mapped(small_case(), np.eye(3) / 10.0), 'skin: the trunk is 57.5 mm tall.*; set units = "cm"'),
    (mapped(small_case(), np.diag([1, -1, -1])),
     'case: axes = "LPS" does not put the vertebrae behind the ASIS nor T7 above L3 in'),
    (hips_exchanged(small_case()), "they seem exchanged; correct their names"),
]  # fmt: skip


@pytest.mark.parametrize(("case", "rule"), REFUSED, ids=lambda value: value if isinstance(value, str) else "")
def test_what_cannot_be_a_patient_is_refused(case: Case, rule: str) -> None:
    refused(case, rule, CaseSource(units="mm"))


def test_a_landmark_may_be_12_mm_from_its_bone() -> None:
    check_case(moved("T7_superior_endplate", [0.0, 0.0, 12.0]))


def test_left_and_right_exchanged_are_refused():
    case, rib = small_case(), small_case().bones["rib_left_07"]
    mirrored = Surface(rib.vertices * [-1.0, 1.0, 1.0], rib.faces[:, ::-1].copy())
    assert check_case(replace(case, bones=case.bones | {"rib_right_07": mirrored})) == ()
    wrong = replace(case, bones=case.bones | {"rib_right_07": rib, "rib_left_07": mirrored})
    off = 2.0 * rib.vertices.mean(axis=0)[0]
    refused(wrong, rf"^rib_left_07: must lie left of rib_right_07, but lies {off:.0f} mm right of it")


@pytest.mark.parametrize("factor", [1.0, 1.45])
def test_a_skin_of_another_scale_is_warned_of(factor):
    case = small_case()
    middle = case.skin.vertices.mean(axis=0)
    skin = Surface((case.skin.vertices - middle) * factor + middle, case.skin.faces)
    warnings = check_case(replace(case, skin=skin))
    assert len(warnings) == (factor > 1.0)
    assert all(text.startswith("skin: the vertebrae lie") and "3 to 35 mm is usual" in text for text in warnings)


def with_sternum(bend: float = 0.0, name: str = "sternum", keep: int | None = None) -> Case:
    """The small case and its sternum after surgery, turned and shifted, and bent."""
    bone = small_case().bones["sternum"]
    points = Rotation.from_rotvec([0.1, 0.0, 0.2]).apply(bone.vertices) + 4.0
    height = (bone.vertices[:, 2] - bone.vertices[:, 2].mean()) / np.ptp(bone.vertices[:, 2])
    points[:, 1] += bend * height**2
    faces = bone.faces if keep is None else bone.faces[(bone.faces < keep).all(axis=1)]
    return replace(small_case(), bones_after={name: Surface(points[:keep], faces)})


def test_bones_after_surgery_are_those_before_moved_rigidly(tmp_path):
    case = with_sternum()
    write_case(tmp_path, case)
    back = read_case(tmp_path).bones_after
    np.testing.assert_array_equal(back["sternum"].vertices, case.bones_after["sternum"].vertices)
    with pytest.raises(InputError, match=r"bones_after/sternum\.ply.*remove it"):
        write_case(tmp_path, small_case())
    refused(with_sternum(bend=80.0), r"bones_after/sternum: is \d+\.\d mm .* 3 mm is allowed")
    refused(with_sternum(keep=40), r"has 40 vertices, but the bone before has \d+")
    refused(with_sternum(name="manubrium"), "no bone 'manubrium' before")


@pytest.mark.parametrize(
    ("signs", "axes", "more"),
    [
        (
            (-1, 1, 1),
            "RPS",
            "if the files are written so; exchanging names of left and right instead would mirror",
        ),
        ((-1, -1, 1), "RAS", "asis_left left of asis_right nor the vertebrae behind the ASIS"),
        ((1, -1, 1), "LAS", "the vertebrae behind the ASIS"),
    ],
)
def test_anatomy_in_other_axes_is_offered_those_and_no_other_names(signs, axes, more, tmp_path):
    """Obeying the offer gives the case as it was, its right curve on the right."""
    whole = small_case()
    write_case(tmp_path, mapped(whole, np.diag(signs)))
    with refuses(f'write axes = "{axes}"', more):
        read_case(tmp_path)
    header = (tmp_path / "case.toml").read_text(encoding="utf-8").replace('"LPS"', f'"{axes}"')
    (tmp_path / "case.toml").write_text(header, encoding="utf-8")
    np.testing.assert_array_equal(read_case(tmp_path).landmarks_before.points, whole.landmarks_before.points)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda v: v * [-1, -1, 1], "fits the skin before surgery better after half a turn"),
        (lambda v: v + np.array([80.0, 0, 0]), "does not hold the bones"),
        (lambda v: v + np.array([0, 80.0, 0]), "does not hold the bones"),
        (lambda v: v * 1.02 + [3.0, 2.0, 0], None),
    ],
)
def test_a_second_skin_that_does_not_hold_the_bones_is_refused(change, said):
    case = small_case()
    x, y, z = case.skin.vertices.T
    y = y + 25.0 * np.exp(-(((z - z.mean()) / 80.0) ** 2)) * (y < y.mean())  # flatter in front: no ellipse
    skin = Surface(np.column_stack([x, y, z]), case.skin.faces)
    case = replace(case, skin=skin, bones={n: b for n, b in case.bones.items() if n != "sternum"})
    case = replace(case, actual_skin=Surface(change(skin.vertices), skin.faces))
    if said is None:
        assert not [warning for warning in check_case(case) if "actual_skin" in warning]
        return
    with pytest.raises(InputError, match=f"actual_skin: {said}"):
        check_case(case)


def test_a_second_skin_after_a_large_correction_holds_the_bones_where_the_plan_puts_them():
    """T7, its left rib, T12 and L3 go 60 mm to the right, and the skin with them."""
    case = small_case()
    names, before = case.landmarks_before.names, case.landmarks_before.points
    way = np.array([-60.0 * name.startswith(("T", "L3")) for name in names])[:, None] * [1.0, 0.0, 0.0]
    planned = replace(case, landmarks_after=Landmarks(names, before + way))
    x, y, z = case.skin.vertices.T
    moved = x - 60.0 * np.clip((z - before[names.index("asis_left"), 2]) / 60.0, 0.0, 1.0)
    second = Surface(np.column_stack([moved, y, z]), case.skin.faces)
    assert all("does not hold" not in warning for warning in check_second_skin(planned, second, "skin"))
    with pytest.raises(InputError, match="does not hold the bones"):
        check_second_skin(replace(case, landmarks_after=None), second, "skin")


@pytest.mark.parametrize(
    ("shift", "sign", "said"),
    [
        ([0, 200, 0], [-1, -1, 1], "skin holds all bones with x and y negated, so it is in RAS: write SPACE=RAS"),
        ([200, 0, 0], [-1, 1, 1], "skin holds all bones with x negated, so it is mirrored"),
        ([200, 0, 0], [1, 1, 1], "bring both into one frame"),
    ],
)
def test_the_frame_in_which_a_skin_would_hold_the_bones_is_named(shift, sign, said):
    case = small_case()
    move = np.array(shift, dtype=float)
    skin = case.skin.moved((case.skin.vertices + move) * sign)
    faces = skin.faces if np.prod(sign) > 0 else skin.faces[:, ::-1]
    bones = {name: bone.moved(bone.vertices + move * (sign != [1, 1, 1])) for name, bone in case.bones.items()}
    refused(replace(case, skin=Surface(skin.vertices, faces), bones=bones), said)


BEFORE, AFTER = before_and_after()


def test_a_curved_and_turned_spine_is_in_order():
    assert check_order(BEFORE, "here") == []


def test_reconstructions_with_the_errors_of_the_papers_are_in_order():
    random = np.random.default_rng(3)
    refused = 0
    for _ in range(300):  # 5100 vertebrae
        try:
            check_order(with_errors(BEFORE, random), "here")
        except InputError:
            refused += 1
    assert refused <= 3


@pytest.mark.parametrize(("point", "other"), list(combinations(VERTEBRA_POINTS, 2)))
@pytest.mark.parametrize("level", ["T1", "T8", "L5"])
def test_two_points_exchanged_are_found(level, point, other):
    with pytest.raises(InputError, match=rf"^here: in {level} the .* must lie .* where two are exchanged"):
        check_order(exchanged(BEFORE, (f"{level}_{point}", f"{level}_{other}")), "here")


@pytest.mark.parametrize("upper", range(16))
def test_neighbouring_vertebrae_exchanged_are_found(upper):
    above, other = LEVELS[upper : upper + 2]
    with pytest.raises(InputError, match=r"must lie above .* along the spine, but lies below") as error:
        check_order(exchanged(BEFORE, (above, other)), "here")
    assert above in str(error.value) or other in str(error.value)


def test_a_point_a_little_on_the_wrong_side_is_a_warning():
    points = BEFORE.points.copy()
    upper, lower = BEFORE.index("T5_left_pedicle_superior"), BEFORE.index("T5_left_pedicle_inferior")
    points[upper] = points[lower] - [0.0, 0.0, 2.7]
    (text,) = check_order(Landmarks(BEFORE.names, points), "here")
    assert text.startswith("here: in T5 the left pedicle's superior point must lie above its inferior one")
    points[upper] = points[lower] - [0.0, 0.0, 3.6]
    with pytest.raises(InputError, match=r"pedicle's superior point must lie above .* mark them again"):
        check_order(Landmarks(BEFORE.names, points), "here")


def test_vertebrae_that_move_rigidly_pass():
    assert check_shapes(BEFORE, AFTER, "after") == []


def test_two_reconstructions_with_the_errors_of_the_papers_pass():
    random = np.random.default_rng(5)
    refused = warned = 0
    for _ in range(40):  # 680 vertebrae
        try:
            warned += len(check_shapes(with_errors(BEFORE, random), with_errors(AFTER, random), "after"))
        except InputError:
            refused += 1
    assert refused <= 2
    assert warned <= 25


@pytest.mark.parametrize("off", [9.0, 40.0])
@pytest.mark.parametrize("name", ["T1_superior_endplate", "T8_left_pedicle_superior", "L5_right_pedicle_inferior"])
def test_one_point_off_is_refused_and_named(name, off):
    wrong = shifted(AFTER, name, (0.0, off, 0.0))
    with pytest.raises(
        InputError, match=rf"^after: '{name}' is {off:.1f} mm from its position by the other five"
    ) as error:
        check_shapes(BEFORE, wrong, "after")
    assert "mark it again" in str(error.value)


def test_half_of_that_is_a_warning():
    (text,) = check_shapes(BEFORE, shifted(AFTER, "T8_left_pedicle_superior", (3.0, 4.0, 0.0)), "after")
    assert text.startswith("after: 'T8_left_pedicle_superior' is 5.0 mm from")
    assert "seldom reach 4.0 mm" in text
    (text,) = check_shapes(BEFORE, shifted(AFTER, "T8_left_pedicle_superior", (7.9, 0.0, 0.0)), "after")
    assert check_shapes(BEFORE, shifted(AFTER, "T8_left_pedicle_superior", (3.9, 0.0, 0.0)), "after") == []
    assert check_shapes(BEFORE, shifted(AFTER, "T8_left_pedicle_superior", (3.0, 0.0, 0.0)), "after") == []


def test_an_exchange_is_refused():
    with pytest.raises(InputError, match=r"which is rigid.* where two are exchanged"):
        check_shapes(BEFORE, exchanged(AFTER, ("T8_superior_endplate", "T8_inferior_endplate")), "after")


@pytest.mark.parametrize("factor", [0.9, 1.06, [1.0, 1.0, 1.25]])
def test_another_patient_is_refused(factor):
    other = Landmarks(AFTER.names, AFTER.points * factor)
    with pytest.raises(InputError, match="the vertebrae belong to another patient"):
        check_shapes(BEFORE, other, "after")


@pytest.mark.parametrize(("moved", "said"), [(4.9, 0), (5.1, 1), (9.9, 1)])
def test_an_iliac_spine_that_moves_is_warned_of(moved, said):
    warnings = check_frame(BEFORE, shifted(AFTER, "asis_right", (0.0, 0.0, moved)), "after")
    assert len(warnings) == said
    assert all(text.startswith(f"after: 'asis_right' moves by {moved:.1f} mm") for text in warnings)


@pytest.mark.parametrize(
    "move", [lambda p: p + np.array([0.0, 20.0, 0.0]), lambda p: Rotation.from_rotvec([0, 0, 0.17]).apply(p)]
)
def test_another_frame_is_refused_and_the_cure_named(move):
    with pytest.raises(InputError, match=r"'asis_\w+' moves by .* --align-pelvis"):
        check_frame(BEFORE, Landmarks(AFTER.names, move(AFTER.points)), "after")


def test_bending_moves_a_landmark_farther_than_surgery():
    far = shifted(BEFORE, BEFORE.names[0], (300.0, 0.0, 0.0))
    check_motion(BEFORE, far, "here", "bending")
    with pytest.raises(InputError, match=r"moves 300\.0 mm, 150 mm is allowed"):
        check_motion(BEFORE, far, "here")


@pytest.mark.parametrize("axis", [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
def test_aligning_undoes_a_shift_and_a_turn_that_the_iliac_spines_show(axis):
    case = small_case()
    turn = Rotation.from_rotvec(np.radians(10.0) * np.array(axis))

    def away(points):
        return turn.apply(points) + np.array([20.0, -5.0, 7.0])

    after = case.planned_landmarks
    moved = replace(
        case,
        landmarks_after=Landmarks(after.names, away(after.points)),
        actual_skin=Surface(away(case.skin.vertices), case.skin.faces),
        bones_after={"T7": Surface(away(case.bones["T7"].vertices), case.bones["T7"].faces)},
    )
    back = align_pelvis(moved)
    np.testing.assert_allclose(back.planned_landmarks.points, after.points, atol=1e-9)
    np.testing.assert_allclose(not_none(back.actual_skin).vertices, case.skin.vertices, atol=1e-9)
    np.testing.assert_allclose(back.bones_after["T7"].vertices, case.bones["T7"].vertices, atol=1e-9)
    with pytest.raises(InputError, match="--align-pelvis"):
        check_case(moved)
    assert check_case(replace(back, actual_skin=None)) == ()


PALPATED = palpated(small_case())


def with_mark_moved(case: Case, name: str, by: list[float]) -> Case:
    """The case with one landmark elsewhere, before and after surgery alike."""

    def moved(landmarks: Landmarks) -> Landmarks:
        rows = np.array(landmarks.names)[:, None] == name
        return Landmarks(landmarks.names, landmarks.points + rows * np.array(by))

    return replace(
        case, landmarks_before=moved(case.landmarks_before), landmarks_after=moved(case.planned_landmarks)
    )


@pytest.mark.parametrize("away", [-45.0, 60.0])
def test_they_must_lie_near_the_skin(away: float) -> None:
    off = with_mark_moved(PALPATED, "asis_right", [0.0, away, 0.0])
    with pytest.raises(InputError, match=r"'asis_right' is 3.* mm from skin, 30 mm is allowed; .*hip bone"):
        check_case(off)


def test_a_plan_that_moves_nothing_is_warned_of():
    case = small_case()
    still = replace(case, landmarks_after=case.landmarks_before)
    assert [w for w in check_case(still) if "moves no landmark" in w]
    assert not [w for w in check_case(case) if "moves no landmark" in w]

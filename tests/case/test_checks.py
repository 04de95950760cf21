"""Checks of a case: the answer to each fault, and just within and just beyond each limit."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.asserting import not_none, refuses
from support.known_spine import LEVELS, before_and_after, exchanged, shifted, with_errors
from support.refusals import plain_line, refusal, row
from support.shown import check_shown
from support.small_case import mapped, palpated, part_case, small_case
from support.synthetic import box, sphere
from warp_trunk.bone_motion.articulation import given_motions
from warp_trunk.bone_motion.skeleton import Skeleton
from warp_trunk.case import Case, read_case, write_case
from warp_trunk.case.checks import CaseSource, check_case
from warp_trunk.case.landmark_checks import align_pelvis, check_frame, check_motion, check_order, check_shapes
from warp_trunk.case.landmarks import VERTEBRA_POINTS, Landmarks
from warp_trunk.case.motion_checks import check_passing
from warp_trunk.case.motions import Motion, Turn
from warp_trunk.case.points import Points
from warp_trunk.case.skin_checks import arm_warnings, check_second_skin
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface

SMALL, PART = small_case(), part_case(front=Motion(translation=(0.0, -1.0, 0.0)))
MARKS, PLANNED = SMALL.landmarks_before, SMALL.planned_landmarks
BEFORE, AFTER = before_and_after()
Check = Callable[[], Iterable[str]]


def said(name: str, check: Check) -> list[str]:
    """The answer of a check, in rows of an accepted text."""
    with row(name):
        try:
            texts = list(check()) or ["nothing"]
        except InputError as error:
            texts = [f"refused: {error}"]
    return [f"{name}: {plain_line(text, Path('nowhere'))}" for text in texts]


def of_case(case: Case) -> Check:
    return lambda: check_case(case, CaseSource(units="mm"))


def in_place(marks: Landmarks, name: str, place: object) -> Landmarks:
    points = marks.points.copy()
    points[marks.index(name)] = place
    return Landmarks(marks.names, points)


def both(change: Callable[[Landmarks], Landmarks], case: Case = SMALL) -> Case:
    """The case with its landmarks before and after surgery changed alike."""
    sets = change(case.landmarks_before), change(case.planned_landmarks)
    return replace(case, landmarks_before=sets[0], landmarks_after=sets[1])


def without(*begins: str) -> Callable[[Landmarks], Landmarks]:
    def fewer(marks: Landmarks) -> Landmarks:
        rows = [place for place, name in enumerate(marks.names) if not name.startswith(begins)]
        return Landmarks(tuple(marks.names[place] for place in rows), marks.points[rows])

    return fewer


def off(name: str, *by: float, case: Case = SMALL) -> Case:
    return both(lambda marks: shifted(marks, name, by), case)  # pyright: ignore[reportArgumentType]


def flat(thickness: float) -> Case:
    """Landmarks of this root mean square distance from a plane [mm]."""

    def thin(marks: Landmarks) -> Landmarks:
        y = np.where(np.arange(len(marks.names)) % 2, -thickness, thickness)
        return Landmarks(marks.names, np.column_stack([marks.points[:, 0], y, marks.points[:, 2]]))

    return both(thin)


def grown(case: Case, factor: float) -> Case:
    """Skin and bones of a part of the body, larger."""
    bones = {name: bone.moved(bone.vertices * factor) for name, bone in case.bones.items()}
    return replace(case, skin=case.skin.moved(case.skin.vertices * factor), bones=bones)


def with_skin(change: Callable[[np.ndarray], np.ndarray], key: str = "skin") -> Case:
    """Another skin: the one of the case, its points about the middle of their box changed."""
    middle = 0.5 * (SMALL.skin.vertices.min(axis=0) + SMALL.skin.vertices.max(axis=0))
    return replace(SMALL, **{key: SMALL.skin.moved(change(SMALL.skin.vertices - middle) + middle)})


def with_bone(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Case:
    bone = SMALL.bones[name]
    return replace(SMALL, bones=SMALL.bones | {name: bone.moved(change(bone.vertices))})


def sternum_after(bend: float = 0.0, name: str = "sternum", keep: int | None = None) -> Case:
    """The sternum after surgery, turned and shifted, and bent."""
    bone = SMALL.bones["sternum"]
    points = Rotation.from_rotvec([0.1, 0.0, 0.2]).apply(bone.vertices) + 4.0
    height = (bone.vertices[:, 2] - bone.vertices[:, 2].mean()) / np.ptp(bone.vertices[:, 2])
    points[:, 1] += bend * height**2
    faces = bone.faces if keep is None else bone.faces[(bone.faces < keep).all(axis=1)]
    return replace(SMALL, bones_after={name: Surface(points[:keep], faces)})


def followed(*places: object, pairs: dict[str, str] | None = None) -> Check:
    names = ("soft", "hard", "other")[: len(places)]
    return of_case(replace(SMALL, points=Points(Landmarks(names, np.array(places)), pairs or {})))


def turned(degrees: float, point: tuple[float, float, float]) -> Motion:
    return Motion(rotation=Turn(degrees=degrees, axis=(0.0, 0.0, 1.0), point=point))


def passing(by: float) -> Check:
    """The front goes backwards, to the core 22 mm behind it."""
    case = part_case(front=Motion(translation=(0.0, by, 0.0)))
    motions = given_motions(Skeleton(case.bones), case.given_motions)
    return lambda: check_passing(case, motions, "motions") or ()


def hips_exchanged() -> Case:
    hips = {"hip_left": SMALL.bones["hip_right"], "hip_right": SMALL.bones["hip_left"]}
    return replace(SMALL, bones={**SMALL.bones, **hips})


def ribs(*names: str) -> Case:
    """Both ribs of the seventh vertebra under these names."""
    rib = SMALL.bones["rib_left_07"]
    mirrored = Surface(rib.vertices * [-1.0, 1.0, 1.0], rib.faces[:, ::-1].copy())
    return replace(SMALL, bones=SMALL.bones | dict(zip(names, (rib, mirrored), strict=True)))


def other_frame(shift: tuple[float, float, float], x: int, y: int) -> Check:
    """Skin and bones in two frames; they hold each other where the skin's axes are changed."""
    move, sign = np.array(shift), np.array([x, y, 1])
    skin = SMALL.skin.moved((SMALL.skin.vertices + move) * sign)
    faces = skin.faces if x * y > 0 else skin.faces[:, ::-1]
    shifts = move * (sign != [1, 1, 1])
    bones = {name: bone.moved(bone.vertices + shifts) for name, bone in SMALL.bones.items()}
    return of_case(replace(SMALL, skin=Surface(skin.vertices, faces), bones=bones))


def wavy(marks: Landmarks, size: float) -> Landmarks:
    """Every point off by some part of a length [mm], in a direction of its own."""
    number = np.arange(len(marks.names))[:, None]
    return Landmarks(marks.names, marks.points + size * np.sin(number * [1.7, 2.3, 3.1] + [0.0, 1.0, 2.0]))


def larger(marks: Landmarks, factor: float, levels: int = 17) -> Check:
    names = [
        name for name in marks.names if name.startswith((*(f"{level}_" for level in LEVELS[:levels]), "asis"))
    ]
    some = [Landmarks(tuple(names), np.array([m.point(name) for name in names])) for m in (BEFORE, marks)]
    return lambda: check_shapes(some[0], Landmarks(some[1].names, some[1].points * factor), "after")


def second_skin(change: Callable[[np.ndarray], np.ndarray]) -> Check:
    """Of a skin that is flatter in front, so that half a turn is seen."""
    x, y, z = SMALL.skin.vertices.T
    y = y + 25.0 * np.exp(-(((z - z.mean()) / 80.0) ** 2)) * (y < y.mean())
    skin = SMALL.skin.moved(np.column_stack([x, y, z]))
    case = replace(SMALL, skin=skin, bones={n: b for n, b in SMALL.bones.items() if n != "sternum"})
    return lambda: check_second_skin(case, skin.moved(change(skin.vertices)), "second")


def corrected(planned: bool) -> Check:
    """T7, its left rib, T12 and L3 go 60 mm to the right, and the second skin with them."""
    way = np.array([-60.0 * name.startswith(("T", "L3")) for name in MARKS.names])[:, None] * [1.0, 0.0, 0.0]
    after = Landmarks(MARKS.names, MARKS.points + way) if planned else None
    x, y, z = SMALL.skin.vertices.T
    moved = x - 60.0 * np.clip((z - MARKS.point("asis_left")[2]) / 60.0, 0.0, 1.0)
    second = SMALL.skin.moved(np.column_stack([moved, y, z]))
    return lambda: check_second_skin(replace(SMALL, landmarks_after=after), second, "second")


def with_arm(side: float) -> Check:
    """A square bar beside the trunk, over all heights."""
    bar = box((side, side, 600.0), (300.0, 0.0, 287.0))
    faces = np.concatenate([SMALL.skin.faces, bar.faces + len(SMALL.skin.vertices)])
    skin = Surface(np.concatenate([SMALL.skin.vertices, bar.vertices]), faces)
    return lambda: arm_warnings(skin, MARKS, "skin")


T5, OFF = "T5_left_pedicle", "T8_left_pedicle_superior"
ON_SKIN = SMALL.skin.vertices[SMALL.skin.vertices[:, 1].argmin()]
ON_BONE = SMALL.bones["T7"].vertices[0]
STRANGERS = Landmarks(("x", "w"), MARKS.points[:2])
FORWARD, LEFT = np.array([0.0, -1.0, 0.0]), np.array([1.0, 0.0, 0.0])
FAULTS: dict[str, Check] = {
    "a good case": of_case(SMALL),
    "three landmarks": of_case(both(lambda m: Landmarks(m.names[:3], m.points[:3]))),
    "no right iliac spine": of_case(both(without("asis_right"))),
    "one vertebra": of_case(both(without("L3", "T12"))),
    "five of six points": of_case(both(without("T12_left_pedicle_superior"))),
    "no bone of a point": of_case(replace(SMALL, bones={n: b for n, b in SMALL.bones.items() if n != "T7"})),
    "a point of nothing": of_case(both(lambda m: Landmarks(("who", *m.names[1:]), m.points))),
    "bending by other names": of_case(replace(SMALL, bending_left=STRANGERS)),
    "bending to the right": of_case(replace(SMALL, bending_right=STRANGERS)),
    "other names after": of_case(replace(SMALL, landmarks_after=Landmarks(("x", *MARKS.names[1:]), MARKS.points))),
    "supine": of_case(replace(SMALL, posture="supine", notes=("A note.",))),
    "prone": of_case(replace(SMALL, posture="prone")),
    "a skin in cm": of_case(with_skin(lambda v: 0.1 * v)),
    "a skin in inches": of_case(with_skin(lambda v: v / 25.4)),
    "an actual skin in m": of_case(with_skin(lambda v: 1e-3 * v, "actual_skin")),
    "a case in cm": of_case(mapped(SMALL, np.eye(3) / 10.0)),
    "turned about the left": of_case(mapped(SMALL, np.diag([1, -1, -1]))),
    "hips exchanged": of_case(hips_exchanged()),
    "both ribs": of_case(ribs("rib_left_07", "rib_right_07")),
    "ribs exchanged": of_case(ribs("rib_right_07", "rib_left_07")),
    "parts exchanged": of_case(replace(PART, bones={
        "part_left": PART.bones["right"], "part_right": PART.bones["left"]})),
    "a bone inside out": of_case(replace(SMALL, bones=SMALL.bones | {
        "T7": Surface(SMALL.bones["T7"].vertices, SMALL.bones["T7"].faces[:, ::-1].copy())})),
    "a skin of two pieces": of_case(replace(PART, skin=Surface(
        np.concatenate([PART.skin.vertices, sphere(9.0, (0.0, 0.0, 300.0)).vertices]),
        np.concatenate([PART.skin.faces, sphere(9.0).faces + len(PART.skin.vertices)])))),
    "a bone after of another shape": of_case(sternum_after(keep=40)),
    "a bone after that is none": of_case(sternum_after(name="manubrium")),
    "a plan that moves nothing": of_case(replace(SMALL, landmarks_after=MARKS)),
    "a skin in RAS": other_frame((0, 200, 0), -1, -1),
    "a mirrored skin": other_frame((200, 0, 0), -1, 1),
    "a skin elsewhere": other_frame((200, 0, 0), 1, 1),
    "a spine in order": lambda: check_order(BEFORE, "here"),
    "a spine with its back in front": lambda: check_order(
        replace(BEFORE, points=BEFORE.points * [1, -1, 1]), "here"),
    "an endplate to the left": lambda: check_order(shifted(BEFORE, "T5_superior_endplate", (20, 0, 0)), "here"),
    "an endplate to the right": lambda: check_order(shifted(BEFORE, "T5_inferior_endplate", (-20, 0, 0)), "here"),
    "pedicles exchanged": lambda: check_order(
        exchanged(BEFORE, *((f"T5_left_pedicle_{e}", f"T5_right_pedicle_{e}") for e in ("superior", "inferior"))),
        "here"),
    "vertebrae that move as they are": lambda: check_shapes(BEFORE, AFTER, "after"),
    "an endplate and a pedicle exchanged": lambda: check_shapes(
        BEFORE, exchanged(AFTER, ("T8_superior_endplate", "T8_left_pedicle_superior")), "after"),
    "another frame after": lambda: check_frame(BEFORE, replace(AFTER, points=AFTER.points + 20.0 * LEFT), "after"),
    "a second skin after half a turn": second_skin(lambda v: v * [-1, -1, 1]),
    "a second skin beside the first": second_skin(lambda v: v + 80.0 * LEFT),
    "a second skin in front of the first": second_skin(lambda v: v + 80.0 * FORWARD),
    "a second skin above the first": second_skin(lambda v: v + 6.0 * np.array([0, 0, 100])),
    "a second skin that is larger": second_skin(lambda v: v * 1.02 + [3.0, 2.0, 0]),
    "a corrected skin where the plan is": corrected(planned=True),
    "a corrected skin without a plan": corrected(planned=False),
    "a pair of two points on skin": followed(ON_SKIN, SMALL.skin.vertices[900], pairs={"soft": "hard"}),
    "a pair of two points on bone": followed(ON_BONE, SMALL.bones["L3"].vertices[0], pairs={"soft": "hard"}),
    "a pair with nothing": followed(ON_SKIN, ON_BONE, pairs={"soft": "none"}),
    "a pair": followed(ON_SKIN, ON_BONE, pairs={"soft": "hard"}),
}  # fmt: skip
LIMITS: dict[str, tuple[Callable[[float], Check], tuple[float, ...]]] = {
    "points apart by": (lambda by: of_case(both(lambda m: in_place(m, "L3_left_pedicle_superior", m.point(
        "L3_left_pedicle_inferior") + by * LEFT))), (0.09, 0.11)),
    "landmarks off a plane by": (lambda by: of_case(flat(by)), (1.04, 1.06)),
    "a landmark off its bone by": (lambda by: of_case(off("T7_superior_endplate", 0, 0, by)), (15.0, 15.2)),
    "a palpated iliac spine forward by": (
        lambda by: of_case(off("asis_right", *(by * FORWARD), case=palpated(SMALL))),
        (-60, -45, 35, 36)),
    "a case larger by": (lambda by: of_case(mapped(SMALL, by * np.eye(3))), (0.433, 0.436, 1.56, 1.57, 3.8, 3.9)),
    "a part of the body larger by": (lambda by: of_case(grown(PART, by)), (0.187, 0.189, 13.7, 13.8)),
    "a skin wider by": (lambda by: of_case(with_skin(lambda v: v * [by, by, 1])), (1.1, 1.42, 1.45)),
    "a skin forward by": (lambda by: of_case(with_skin(lambda v: v + by * FORWARD)), (2, 4, 8, 9)),
    "the sternum forward by": (lambda by: of_case(with_bone("sternum", lambda v: v + by * FORWARD)),
                               (9.8, 10.6, 14.3, 14.7)),
    "the sternum bent by": (lambda by: of_case(sternum_after(by)), (33, 35)),
    "a followed point off by": (lambda by: followed(ON_SKIN + by * FORWARD), (4.9, 5.1)),
    "a landmark moves by": (lambda by: lambda: check_motion(BEFORE, shifted(BEFORE, OFF, (by, 0, 0)), "here"),
                            (0.04, 0.06, 149.9, 150.1)),
    "a landmark moves in bending by": (
        lambda by: lambda: check_motion(BEFORE, shifted(BEFORE, OFF, (by, 0, 0)), "here", "bending"),
        (399.9, 400.1)),
    "a pedicle's point too low by": (
        lambda by: lambda: check_order(in_place(BEFORE, f"{T5}_superior", BEFORE.point(
            f"{T5}_inferior") - [0, 0, by]), "here"), (-0.2, 0.2, 2.8, 3.4)),
    "a landmark off by the shape by": (
        lambda by: lambda: check_shapes(BEFORE, shifted(AFTER, OFF, (by, 0, 0)), "after"), (3.9, 4.1, 7.9, 8.1)),
    "a landmark off among errors by": (
        lambda by: lambda: check_shapes(wavy(BEFORE, 1.5), shifted(AFTER, OFF, (by, 0, 0)), "after"),
        (7.0, 8.0, 9.5, 10.5)),
    "a landmark off among large errors by": (
        lambda by: lambda: check_shapes(wavy(BEFORE, 2.6), shifted(AFTER, OFF, (by, 0, 0)), "after"),
        (9.0, 11.0, 13.0, 15.0, 17.0)),
    "errors of all landmarks": (lambda by: lambda: check_shapes(wavy(BEFORE, by), AFTER, "after"), (3.0, 3.2)),
    "vertebrae larger by": (lambda by: larger(AFTER, by), (0.9, 0.961, 0.963, 1.037, 1.039, 1.049, 1.051)),
    "7 vertebrae larger by": (lambda by: larger(AFTER, by, 7), (1.06,)),
    "8 vertebrae larger by": (lambda by: larger(AFTER, by, 8), (1.06,)),
    "an iliac spine moves up by": (
        lambda by: lambda: check_frame(BEFORE, shifted(AFTER, "asis_right", (0, 0, by)), "after"),
        (4.9, 5.1, 9.9, 10.1)),
    "an iliac spine moves aside by": (
        lambda by: lambda: check_frame(BEFORE, shifted(AFTER, "asis_left", (by, 0, 0)), "after"),
        (-9.9, -10.1, 10.1)),
    "a second skin aside by": (lambda by: second_skin(lambda v: v + by * LEFT), (34, 36, 38)),
    "a second skin narrower by": (lambda by: second_skin(lambda v: v * [by, by, 1]), (0.75, 0.8)),
    "a second skin wider by": (lambda by: second_skin(lambda v: v * [by, by, 1]), (1.3, 1.4, 1.5)),
    "an arm of side": (with_arm, (22.2, 22.5)),
    "a bone moves by": (lambda by: of_case(part_case(front=Motion(translation=(0, 0, by)))), (59.9, 60.1)),
    "a bone turns by": (lambda by: of_case(part_case(front=turned(by, (0, -45, 100)))), (59.9, 60.1)),
    "a point of rotation in front by": (
        lambda by: of_case(part_case(front=turned(1, (0, -80 - by, 100)))), (199, 201)),
    "a point of rotation above by": (lambda by: of_case(part_case(front=turned(1, (0, 0, 180 + by)))), (199, 201)),
    "fractions of": (
        lambda by: of_case(part_case(front=Motion(follows={"core": by, "left": by}))), (-0.1, 0, 0.5, 0.51)),
    "a bone passes by": (passing, (23.4, 23.6)),
}  # fmt: skip


def test_what_is_said_of_cases_is_as_accepted() -> None:
    lines = [line for name, check in FAULTS.items() for line in said(name, check)]
    for name, (check_of, values) in LIMITS.items():
        lines += [line for value in values for line in said(f"{name} {value:g}", check_of(value))]
    check_shown("checks", lines)


def test_an_anatomy_in_other_axes_is_offered_those_and_no_other_names(tmp_path):
    """Obeying the offer gives the case as it was, its right curve on the right."""
    lines = []
    for axes, signs in (("RPS", (-1, 1, 1)), ("RAS", (-1, -1, 1)), ("LAS", (1, -1, 1))):
        folder = tmp_path / axes
        write_case(folder, mapped(SMALL, np.diag(signs)))
        lines.append(refusal(axes, folder, lambda folder=folder: read_case(folder)))
        header = (folder / "case.toml").read_text(encoding="utf-8").replace('"LPS"', f'"{axes}"')
        (folder / "case.toml").write_text(header, encoding="utf-8")
        np.testing.assert_array_equal(read_case(folder).landmarks_before.points, MARKS.points)
    check_shown("refused_axes", lines)


def test_bones_after_surgery_are_those_before_moved_rigidly(tmp_path):
    case = sternum_after()
    write_case(tmp_path, case)
    back = read_case(tmp_path).bones_after
    np.testing.assert_array_equal(back["sternum"].vertices, case.bones_after["sternum"].vertices)
    with refuses("bones_after", "remove it"):
        write_case(tmp_path, SMALL)


def test_reconstructions_with_the_errors_of_the_papers_pass():
    random, refused, warned = np.random.default_rng(3), {"order": 0, "shapes": 0}, 0
    for number in range(300):  # 5100 vertebrae
        before = with_errors(BEFORE, random)
        try:
            check_order(before, "here")
        except InputError:
            refused["order"] += 1
        if number % 8 == 0:
            try:
                warned += len(check_shapes(before, with_errors(AFTER, random), "after"))
            except InputError:
                refused["shapes"] += 1
    assert refused["order"] <= 3
    assert refused["shapes"] <= 2
    assert warned <= 25


def test_points_and_vertebrae_that_are_exchanged_are_found():
    for level in ("T1", "T8", "L5"):
        for point, other in combinations(VERTEBRA_POINTS, 2):
            with refuses(f"in {level} the ", " must lie ", "where two are exchanged", begins="here: "):
                check_order(exchanged(BEFORE, (f"{level}_{point}", f"{level}_{other}")), "here")
    for upper, lower in pairwise(LEVELS):
        with pytest.raises(InputError, match=rf"({upper}|{lower}) .*along the spine, but lies below it; their"):
            check_order(exchanged(BEFORE, (upper, lower)), "here")


@pytest.mark.parametrize("axis", [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
def test_aligning_undoes_a_shift_and_a_turn_that_the_iliac_spines_show(axis):
    turn = Rotation.from_rotvec(np.radians(10.0) * np.array(axis))

    def away(points):
        return turn.apply(points) + np.array([20.0, -5.0, 7.0])

    bone = SMALL.bones["T7"]
    moved = replace(
        SMALL,
        landmarks_after=Landmarks(PLANNED.names, away(PLANNED.points)),
        actual_skin=SMALL.skin.moved(away(SMALL.skin.vertices)),
        bones_after={"T7": bone.moved(away(bone.vertices))},
    )
    back = align_pelvis(moved)
    np.testing.assert_allclose(back.planned_landmarks.points, PLANNED.points, atol=1e-9)
    np.testing.assert_allclose(not_none(back.actual_skin).vertices, SMALL.skin.vertices, atol=1e-9)
    np.testing.assert_allclose(back.bones_after["T7"].vertices, bone.vertices, atol=1e-9)
    with refuses("--align-pelvis"):
        check_case(moved)
    assert check_case(replace(back, actual_skin=None)) == ()

"""Back surface rotation and hump heights of sections that are known in closed form, and of a back alone."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from support.asserting import not_none, refuses
from support.trunk_shapes import LEFT, LEVELS, SPINE, ellipse, flat_back, joined, rotation, spine, tube, twisted
from warp_trunk.case.landmarks import Landmarks, write_landmarks
from warp_trunk.cli import main
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface, compact
from warp_trunk.io.surface_files import write_surface
from warp_trunk.measures import measure, measure_back
from warp_trunk.measures.back_rotation import (
    HUMP_DEPENDS,
    Contacts,
    DualTangent,
    back_surface_rotation,
    find_contacts,
    hump_height,
    is_determined,
    is_hump_determined,
    tangent_of,
)


def grooved(count=720, width=25.0):
    """A back with prominences at x = -55 and x = 70, each a cap of a circle, and a valley between them."""
    outline = ellipse(count)
    x, y = outline.T
    y = np.where(y > 0.0, y - 25.0 * np.exp(-(((x - 5.0) / width) ** 2)), y)
    return np.column_stack([x, y])


@pytest.mark.parametrize(("aside", "place"), [(0.0, 10.0), (30.0, 2.0), (30.0, 10.0), (45.0, 4.0), (45.0, 10.0)])
def test_a_hump_beside_a_spine_off_the_middle_is_that_of_the_flank(aside: float, place: float) -> None:
    """Between the ellipse's depths at, or 20 mm from the middle, and as far on the other side of the spine."""

    def height(at: float) -> float:
        near, far = (100.0 * math.sqrt(1.0 - ((max(at, 20.0) + side * at) / 150.0) ** 2) for side in (-1.0, 1.0))
        return near - far

    tangent = not_none(tangent_of(ellipse(4000), np.array([aside, 45.0, 0.0]), LEFT))
    assert hump_height(tangent) == pytest.approx(height(aside), abs=0.1)
    changes = [abs(height(abs(aside + way)) - height(aside)) for way in (-place, place)]
    assert is_hump_determined(tangent, place) == (max(changes) < HUMP_DEPENDS)


def angle(contacts):
    dx, dy = contacts.points[0] - contacts.points[1]
    return math.degrees(math.atan2(dy, dx))


@pytest.mark.parametrize("degrees", [0.0, 3.0, -8.0, 20.0, -35.0])
def test_convex_section_with_the_spine_on_its_axis_gives_its_rotation(degrees):
    turn = rotation(degrees)
    contacts = find_contacts(ellipse() @ turn.T, turn @ SPINE, LEFT)
    assert angle(contacts) == pytest.approx(degrees, abs=1e-7)


@pytest.mark.parametrize("degrees", [0.0, 5.0, -14.0, 25.0])
def test_grooved_section_turns_with_its_rotation(degrees):
    """The reference tangent is found by brute force: no point of the outline lies behind the line."""
    outline = grooved()
    back = outline[outline[:, 1] > 0.0]
    left, right = back[back[:, 0] > 10.0], back[back[:, 0] < 0.0]
    supports = [
        math.degrees(math.atan2(p[1] - q[1], p[0] - q[0]))
        for p in left
        for q in right
        if np.all((p[0] - q[0]) * (back[:, 1] - q[1]) - (p[1] - q[1]) * (back[:, 0] - q[0]) <= 1e-9)
    ]
    assert len(supports) == 1
    turn = rotation(degrees)
    contacts = find_contacts(outline @ turn.T, turn @ SPINE, LEFT)
    assert abs(supports[0]) > 0.5  # the section is not symmetric, so its own angle must be found too
    assert angle(contacts) == pytest.approx(supports[0] + degrees, abs=1e-9)


def lumbar(count=200, apart=30.0, radius=55.0):
    """Two round muscles of one size with a groove between: their common tangent is parallel to the line through
    their centres, at (±apart, 0), and touches them there."""
    t = np.linspace(0.0, math.pi, count)
    right = np.column_stack([apart + radius * np.cos(t), radius * np.sin(t)])
    left = right * [-1.0, 1.0]
    keep = right[:, 0] > 0.0
    front = np.column_stack([-(apart + radius) * np.cos(t), -120.0 * np.sin(t)])[1:-1]
    return np.vstack([right[keep], left[keep][::-1], front])


@pytest.mark.parametrize("degrees", [0.0, -5.4, 12.0])
@pytest.mark.parametrize("aside", [-34.0, 0.0, 34.0])
def test_deep_vertebra_beside_a_narrow_groove_does_not_lose_it(degrees, aside):
    """The muscles are rounder (55 mm) than the vertebra is deep (100 mm): its perpendicular has no fixed point."""
    turn = rotation(degrees)
    contacts = find_contacts(lumbar() @ turn.T, turn @ [aside, -45.0], LEFT)
    assert angle(contacts) == pytest.approx(degrees, abs=0.001)


@pytest.mark.parametrize("start", [-27.0, -31.0, -45.0])
def test_a_hollow_of_the_flank_does_not_turn_a_back_that_is_convex_at_the_spine(start):
    """The hull bridges it by an edge of 60 mm, which does not reach the spine: the back is symmetric there."""
    x, y = ellipse(1440).T
    hollow = (y > 0.0) & (x < start) & (x > start - 60.0)
    y = np.where(hollow, y - 4.0 * np.sin(math.pi * (start - x) / 60.0) ** 2, y)
    assert angle(find_contacts(np.column_stack([x, y]), SPINE, LEFT)) == pytest.approx(0.0, abs=0.01)


def test_a_flat_back_gives_its_rotation_however_rounding_falls():
    """All of the back's points lie on one line, but for the last bit."""
    x = np.linspace(-150.0, 150.0, 9)
    box = np.vstack([np.column_stack([-x, np.full(9, 90.0)]), np.column_stack([x, np.full(9, -90.0)])])
    for degrees in np.linspace(-40.0, 40.0, 400):
        turn = rotation(degrees)
        assert angle(find_contacts(box @ turn.T, turn @ SPINE, LEFT)) == pytest.approx(degrees, abs=1e-7)


@pytest.mark.parametrize("pelvis", [-12.0, 25.0])
def test_the_rotation_is_that_against_the_pelvis_without_the_arms(pelvis):
    """Degrees counterclockwise seen from above, which is negative for a back; the arm is larger than the trunk."""
    turn, asis = rotation(8.0), np.array([[120.0, 0.0], [-120.0, 0.0]]) @ rotation(pelvis).T
    marks = spine({"T8": 200.0}, turn @ SPINE, asis.tolist())
    arm = tube(ellipse(60, 400.0, 45.0) + np.array([600.0, 70.0]))
    tangent = not_none(back_surface_rotation(joined(tube(grooved() @ turn.T), arm), marks)["T8"])
    straight = not_none(back_surface_rotation(tube(grooved()), spine({"T8": 200.0}))["T8"])
    assert tangent.angle == pytest.approx(straight.angle - (8.0 - pelvis), abs=1e-6)


def test_missing_or_coincident_asis_is_named():
    landmarks = spine({"T8": 200.0})
    with pytest.raises(InputError, match="asis_left"):
        back_surface_rotation(tube(ellipse()), Landmarks(landmarks.names[:2], landmarks.points[:2]))
    with pytest.raises(InputError, match="0 mm apart"):
        back_surface_rotation(tube(ellipse()), spine({"T8": 200.0}, asis=((0.0, 0.0), (0.0, 0.0))))


NOWHERE = Contacts(np.zeros((2, 2)), np.zeros((2, 2, 2)), np.zeros((2, 2)))


def height_of(outline, spine_at=(0.0, 0.0), across=LEFT):
    spine_at = np.array(spine_at)
    return hump_height(DualTangent(0.0, NOWHERE, 0.0, outline, spine_at, across))


def peaked_back(bump_at=None, bump=0.0):
    """A rectangle whose back is at y = 60, with a peak of a height at a place of it."""
    back = [[150.0, 60.0], [-150.0, 60.0]]
    if bump_at is not None:
        back[1:1] = [[bump_at + 25.0, 60.0], [bump_at, 60.0 + bump], [bump_at - 25.0, 60.0]]
    return np.array([[-150.0, -100.0], [150.0, -100.0], *back])


@pytest.mark.parametrize(
    ("at", "aside", "expected"),
    [(-70.0, 0.0, 18.0), (70.0, 0.0, -18.0), (-45.0, 0.0, 18.0), (0.0, -60.0, -18.0), (130.0, -60.0, 0.0)],
)
def test_a_peak_on_one_side_is_its_own_height_as_far_as_the_other_side_reaches(at, aside, expected):
    """The last is 190 mm to the left of the spine, and the right side ends 90 mm from it."""
    assert height_of(peaked_back(at, 18.0), (aside, 0.0)) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("degrees", [4.0, 12.0, -9.0])
def test_turned_plane_rises_with_the_distance(degrees):
    """A turned rectangle is highest at its corner; the plane falls evenly from there to the other side."""
    turn = rotation(-degrees)
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(abs(degrees)))
    reach = 150.0 * c - 60.0 * s
    expected = math.copysign(2.0 * reach * math.tan(math.radians(abs(degrees))), degrees)
    assert height_of(peaked_back() @ turn.T) == pytest.approx(expected, rel=1e-9)


def test_largest_of_a_trunk_with_its_level():
    measures = measure(tube(peaked_back(70.0, 18.0)), spine({"T8": 300.0, "T9": 200.0, "T10": 450.0}, (0.0, 0.0)))
    assert measures.hump_height == {"T8": pytest.approx(-18.0), "T9": pytest.approx(-18.0), "T10": None}
    assert (measures.max_hump, measures.hump_level) == (pytest.approx(-18.0), "T8")
    assert height_of(ellipse(half_width=18.0, half_depth=12.0)) is None  # narrower than the span


MARKERS = {"C7": [0.0, 100.0, 390.0], "PSIS_left": [60.0, 90.0, 0.0], "PSIS_right": [-60.0, 90.0, 0.0]}


def markers(**changed):
    table = {name: point for name, point in (MARKERS | changed).items() if point is not None}
    return Landmarks(tuple(table), np.array(list(table.values())))


def behind(surface: Surface) -> Surface:
    """The open part that a scanner behind the trunk sees."""
    return compact(surface.vertices, surface.faces[surface.vertices[surface.faces, 1].mean(axis=1) > 0.0])


def line(depth=0.0):
    z = np.linspace(10.0, 395.0, 60)
    return np.column_stack([np.zeros(60), np.full(60, 100.0 - depth), z])


def test_open_back_of_known_twist():
    back, marks = behind(twisted(20.0)), spine(LEVELS, (0.0, 0.0))
    measured = measure_back(back, marks)
    assert (measured.pelvis, measured.spine) == ("ASIS", "landmarks")
    for level, at in measured.levels.items():
        assert not_none(at).rotation == pytest.approx(LEVELS[level] / 20.0, abs=0.001)


@pytest.mark.parametrize("asis", [True, False])
def test_slope_of_a_flat_back_is_its_rotation(asis):
    back = behind(tube(flat_back() @ rotation(15.0).T))
    spines = {f"ASIS_{side}": [x, 0.0, 0.0] for side, x in (("left", 120.0), ("right", -120.0)) if asis}
    measured = measure_back(back, line(), markers(**spines))
    assert (measured.pelvis, measured.spine) == ("ASIS" if asis else "PSIS", "spinous line")
    at = not_none(measured.levels["T8"])
    assert (at.rotation, at.slope) == (pytest.approx(-15.0, abs=1e-6), pytest.approx(-15.0, abs=1e-6))


def test_slope_beside_the_spine_in_closed_form():
    """A back whose right half rises by 0.2 for each mm away from the spine, and whose left half is flat."""
    outline = np.array([[150.0, 60.0], [0.0, 60.0], [-150.0, 90.0], [-150.0, -60.0], [150.0, -60.0]])
    measured = measure_back(behind(tube(outline[::-1])), line(40.0), markers())
    slopes = {level: at and at.slope for level, at in measured.levels.items()}
    assert slopes["T8"] == pytest.approx(np.degrees(np.arctan(9.0 / 90.0)))
    assert slopes["L2"] == pytest.approx(np.degrees(np.arctan(7.0 / 70.0)))


@pytest.mark.parametrize(("groove", "within"), [(0.0, 1e-6), (12.0, 0.1)])
def test_points_and_a_line_of_bodies_with_markers_on_the_skin(groove, within):
    """A plane that is turned by 8 degrees, or a cylinder with a groove, with two round markers, 5 mm high."""
    x, z = (axis.ravel() for axis in np.meshgrid(np.linspace(-140.0, 140.0, 141), np.linspace(0.0, 400.0, 201)))
    bent = x**2 / 300.0 + groove * np.exp(-((x / 30.0) ** 2)) if groove else 0.0
    points = np.column_stack([x, 100.0 - np.tan(np.radians(8.0)) * x - bent, z])
    smooth = measure_back(points, line(60.0), markers())
    assert smooth.spine == "body line"
    assert smooth.notes == ()
    marked = points.copy()
    for height in (185.0, 135.0) if groove else ():
        marked[:, 1] += np.where(np.hypot(x + 55.0, z - height) < 6.0, 5.0, 0.0)
    for level, other in zip(
        smooth.levels.values(), measure_back(marked, line(60.0), markers()).levels.values(), strict=True
    ):
        for name in ("rotation", "slope"):
            wanted = getattr(not_none(level), name) if groove else 8.0
            assert getattr(not_none(other), name) == pytest.approx(wanted, abs=within)


def test_a_short_line_and_few_points_are_refused():
    with refuses("must be points (n, 3) that reach from C7 to L5, z 23 to 390 mm, and has z 10 to 134 mm"):
        measure_back(behind(tube(ellipse())), line()[:20], markers())
    with refuses("100 or more"):
        measure_back(np.zeros((20, 3)), line(), markers())


def test_command(tmp_path, capsys):
    back = behind(tube(flat_back() @ rotation(-8.0).T))
    write_surface(tmp_path / "back.ply", Surface(back.vertices / 1000.0, back.faces))
    np.savetxt(tmp_path / "spine.csv", line() / 1000.0, delimiter=",", header="x,y,z", comments="")
    write_landmarks(tmp_path / "markers.csv", replace(markers(), points=markers().points / 1000.0))
    place = [str(tmp_path / name) for name in ("back.ply", "spine.csv", "markers.csv")]
    command = ["measure", place[0], "--spine", place[1], "--markers", place[2], "--units", "m"]
    assert main([*command, "--out", str(tmp_path)]) == 0
    record = json.loads((tmp_path / "measures.json").read_text(encoding="utf-8"))
    (angle,) = [row["value"] for row in record["measures"] if (row["level"], row["quantity"]) == ("T8", "bsr_deg")]
    assert angle == pytest.approx(8.0, abs=1e-3)
    assert "against the axis of the PSIS" in capsys.readouterr().out
    assert main([*command, "--case", str(tmp_path)]) == 2


@pytest.mark.parametrize(
    ("outline", "place", "determined"),
    [
        (ellipse(720, 70.0, 70.0), 10.0, False),  # a nape: it turns by 8 degrees over 10 mm
        (ellipse(720, 70.0, 70.0), 0.2, True),
        (flat_back(), 10.0, True),
        (grooved(), 10.0, True),  # an edge of 125 mm bridges the spine wherever it lies
    ],
)
def test_a_round_back_determines_no_rotation_where_the_place_of_the_spine_is_unsure(outline, place, determined):
    tangent = tangent_of(outline, np.array([0.0, 40.0, 100.0]), LEFT)
    assert is_determined(not_none(tangent), place) == determined

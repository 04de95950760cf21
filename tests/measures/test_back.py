"""A back alone: surfaces of known rotation, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest

from support.asserting import there
from support.trunk_shapes import LEVELS, ellipse, flat_back, rotation, spine, tube, twisted
from warp_trunk.case.landmarks import Landmarks, write_landmarks
from warp_trunk.cli import main
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface, compact
from warp_trunk.io.surface_files import write_surface
from warp_trunk.measures import measure, measure_back

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
    found = measure_back(back, marks)
    assert (found.pelvis, found.spine) == ("ASIS", "landmarks")
    for level, one in found.levels.items():
        assert there(one).rotation == pytest.approx(LEVELS[level] / 20.0, abs=0.001)


def test_closed_skin_has_the_numbers_of_measure():
    marks = spine(LEVELS)
    whole = measure(twisted(20.0), marks).bsr
    assert {
        level: one and one.rotation for level, one in measure_back(twisted(20.0), marks).levels.items()
    } == whole


@pytest.mark.parametrize("degrees", [0.0, 8.0, -15.0])
def test_slope_of_a_flat_back_is_its_rotation(degrees):
    back = behind(tube(flat_back() @ rotation(-degrees).T))
    asis = {"ASIS_left": [120.0, 0.0, 0.0], "ASIS_right": [-120.0, 0.0, 0.0]}
    for given, pelvis in ((markers(), "PSIS"), (markers(**asis), "ASIS")):
        found = measure_back(back, line(), given)
        assert (found.pelvis, found.spine) == (pelvis, "spinous line")
        one = there(found.levels["T8"])
        assert (one.rotation, one.slope) == (pytest.approx(degrees, abs=1e-6), pytest.approx(degrees, abs=1e-6))


def test_slope_beside_the_spine_in_closed_form():
    """A back whose right half rises by 0.2 for each mm away from the spine, and whose left half is flat."""
    outline = np.array([[150.0, 60.0], [0.0, 60.0], [-150.0, 90.0], [-150.0, -60.0], [150.0, -60.0]])
    found = measure_back(behind(tube(outline[::-1])), line(40.0), markers())
    slopes = {level: one and one.slope for level, one in found.levels.items()}
    assert slopes["T8"] == pytest.approx(np.degrees(np.arctan(9.0 / 90.0)))
    assert slopes["L2"] == pytest.approx(np.degrees(np.arctan(7.0 / 70.0)))


def test_points_and_a_line_of_bodies():
    x, z = (one.ravel() for one in np.meshgrid(np.linspace(-140.0, 140.0, 141), np.linspace(0.0, 400.0, 201)))
    points = np.column_stack([x, 100.0 - np.tan(np.radians(8.0)) * x, z])
    found = measure_back(points, line(60.0), markers())
    assert found.spine == "body line"
    for one in map(there, found.levels.values()):
        assert (one.rotation, one.slope) == (pytest.approx(8.0, abs=1e-6), pytest.approx(8.0, abs=1e-6))


def test_markers_on_the_skin_do_not_turn_the_back():
    """Two round markers, 5 mm high, on a back in the form of a cylinder that is turned by 8 degrees."""
    x, z = (one.ravel() for one in np.meshgrid(np.linspace(-140.0, 140.0, 141), np.linspace(0.0, 400.0, 201)))
    groove = 12.0 * np.exp(-((x / 30.0) ** 2))
    y = 100.0 - np.tan(np.radians(8.0)) * x - x**2 / 300.0 - groove
    smooth = np.column_stack([x, y, z])
    marked = smooth + 0.0
    for place in ([-55.0, 185.0], [-55.0, 135.0]):
        marked[:, 1] += np.where(np.hypot(x - place[0], z - place[1]) < 6.0, 5.0, 0.0)
    found = [measure_back(one, line(60.0), markers()).levels for one in (smooth, marked)]
    for without, with_them in zip(*(map(there, one.values()) for one in found), strict=True):
        assert with_them.rotation == pytest.approx(without.rotation, abs=0.1)
        assert with_them.slope == pytest.approx(without.slope, abs=0.1)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"markers": markers(PSIS_left=None)}, "PSIS_left and PSIS_right"),
        ({"markers": markers(PSIS_left=[-70.0, 90.0, 0.0])}, "exchange the names"),
        ({"markers": markers(C7=None)}, "needs C7"),
        ({"markers": markers(C7=[0.0, 100.0, 30.0])}, "150 to 750 mm"),
        ({"spine": line()[:20]}, "reach from C7 to L5"),
        ({"back": np.zeros((20, 3))}, "100 or more"),
    ],
)
def test_what_is_refused(given, words):
    whole = {"back": behind(tube(ellipse())), "spine": line(), "markers": markers()}
    with pytest.raises(InputError, match=words):
        measure_back(**(whole | given))


def test_command(tmp_path, capsys):
    back = behind(tube(flat_back() @ rotation(-8.0).T))
    write_surface(tmp_path / "back.ply", Surface(back.vertices / 1000.0, back.faces))
    np.savetxt(tmp_path / "spine.csv", line() / 1000.0, delimiter=",", header="x,y,z", comments="")
    write_landmarks(tmp_path / "markers.csv", replace(markers(), points=markers().points / 1000.0))
    place = [str(tmp_path / name) for name in ("back.ply", "spine.csv", "markers.csv")]
    command = ["measure", place[0], "--spine", place[1], "--markers", place[2], "--units", "m"]
    assert main([*command, "--out", str(tmp_path)]) == 0
    record = json.loads((tmp_path / "measures.json").read_text())
    (angle,) = [one["value"] for one in record["measures"] if (one["level"], one["quantity"]) == ("T8", "bsr_deg")]
    assert angle == pytest.approx(8.0, abs=1e-3)
    assert "against the axis of the PSIS" in capsys.readouterr().out
    assert main([*command, "--case", str(tmp_path)]) == 2

"""Every public function and record refuses what it cannot take: one line that names the argument, before any work.

A public function without a row in `GOOD`, and a public record without one in `RECORDS`, fails.
"""

import inspect
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import warp_trunk
from support.asserting import refuses
from support.report_results import write_small_result
from support.small_case import small_case
from warp_trunk.errors import InputError, MissingFileError

wt: Any = warp_trunk
CASE = small_case()
SKIN, MARKS, BONES = CASE.skin, CASE.landmarks_before, CASE.bones
PLAN = wt.Plan(uiv="T4", liv="L1", curves=[wt.CurvePlan("T8", correction=0.5)])
LINE = wt.PatientSpine("line", MARKS.middles())
HOLED = wt.Surface(np.where(np.arange(len(SKIN.vertices))[:, None] == 5, np.nan, SKIN.vertices), SKIN.faces)
EMPTY, UNMARKED = wt.Surface([], []), wt.Landmarks((), [])

GOOD: dict[str, dict[str, Any]] = {
    "best_plan": {"case": CASE, "plan": PLAN, "within": ["T8,correction=0.4..0.6"]},
    "close_skin": {"parts": {"scan": SKIN}},
    "compare_skins": {"predicted": SKIN, "actual": SKIN, "landmarks": MARKS},
    "find_landmarks": {"bones": BONES},
    "fit_atlas": {"bones": BONES, "atlas": MARKS, "patient": MARKS},
    "fit_back": {"points": SKIN.vertices, "spine": LINE, "markers": MARKS},
    "make_case": {"skin": SKIN, "bones": BONES, "curve": wt.SpineCurve(), "correction": 0.5},
    "measure": {"skin": SKIN, "landmarks": MARKS},
    "measure_back": {"back": SKIN, "spine": MARKS},
    "patient_of": {"case": CASE},
    "phantom_case": {"curve": wt.SpineCurve()},
    "plan_surgery": {"case": CASE, "plan": PLAN},
    "read_case": {"folder": "case"},
    "read_landmarks": {"path": "marks.csv"},
    "read_motions": {"path": "motions.toml"},
    "read_plan": {"path": "plan.toml"},
    "read_result": {"folder": "result"},
    "read_surface": {"path": "skin.ply"},
    "register_skin": {"skin": SKIN, "on_skin": MARKS, "on_films": MARKS},
    "simulate": {"case": CASE},
    "view_result": {"result": "result"},
    "write_case": {"folder": "case", "case": CASE},
    "write_plan": {"path": "plan.toml", "plan": PLAN},
    "write_report": {"result": object.__new__(wt.Result)},
    "write_surface": {"path": "skin.ply", "surface": SKIN},
}
"""Arguments that each function takes, by its name."""
RECORDS: dict[str, dict[str, Any]] = {
    "Axes": {"code": "LPS"},
    "Bound": {"apex": "T8", "target": "correction", "low": 0.4, "high": 0.6},
    "Case": {"name": "a", "skin": SKIN, "bones": BONES, "landmarks_before": MARKS},
    "CurvePlan": {"apex": "T8"},
    "CutPlane": {"point": (0.0, 0.0, 1.0), "normal": (0.0, 0.0, 1.0)},
    "Landmarks": {"names": ("a",), "points": [[1, 2, 3]]},
    "PatientSpine": {"kind": "line", "line": MARKS.middles()},
    "Plan": {"uiv": "T4", "liv": "L1"},
    "StraightBody": {"name": "a", "skin": SKIN, "bones": BONES, "landmarks": MARKS, "psis": np.zeros((2, 3))},
    "Surface": {"vertices": SKIN.vertices, "faces": SKIN.faces},
} | {
    name: {} for name in (
        "CloseOptions", "Execution", "Layers", "MeshOptions", "Motion", "RelaxOptions", "RibCoupling",
        "RunOptions", "SimulationOptions", "SpineCurve", "Study", "Tissue", "Uncertainty",
    )
}  # fmt: skip
"""The same for each record; those that functions alone make are `MADE`."""
MADE = {"Case": CASE, "PreparedPatient": None, "Progress": None, "Result": None}
"""Records and classes that no user fills in field by field."""


def public(keep: Callable[[object], bool]) -> set[str]:
    return {name for name in wt.__all__ if keep(getattr(wt, name))}


def test_every_public_function_and_record_has_a_row() -> None:
    assert set(GOOD) == public(inspect.isfunction)
    assert set(RECORDS) == public(inspect.isclass) - {"InputError", *MADE} | {"Case"}


def wrong_arguments() -> list[Any]:
    rows = []
    for name in (*GOOD, *RECORDS):
        call: Any = getattr(wt, name)
        for argument, parameter in inspect.signature(call).parameters.items():
            wrong = [object(), b"bytes"] + ([] if "None" in str(parameter.annotation) else [None])
            rows += [
                pytest.param(name, argument, value, id=f"{name} {argument} {type(value).__name__}")
                for value in wrong
            ]
    return rows


@pytest.mark.parametrize(("name", "argument", "value"), wrong_arguments())
def test_an_argument_of_another_type_is_named(name: str, argument: str, value: object) -> None:
    arguments = {**(GOOD | RECORDS)[name], argument: value}
    with pytest.raises(InputError) as error:
        getattr(wt, name)(**arguments)
    line = str(error.value)
    assert f"'{argument}'" in line, line
    assert "\n" not in line
    assert len(line) < 400, line


BAD: list[tuple[str, dict[str, Any], str]] = [
    ("best_plan", {"aim": "foo"}, "best_plan: 'aim' must be hump or bsr, not 'foo'"),
    ("best_plan", {"within": []}, "--within: says nothing"),
    ("best_plan", {"within": "T8,correction=0.4..0.6"}, "'within' must be a list"),
    ("best_plan", {"most": 0}, "'most' must be a number from 1"),
    ("close_skin", {"parts": {}}, "parts: there are none"),
    ("close_skin", {"parts": {"scan": HOLED}}, "scan: 1 of 3578 vertices are not finite"),
    ("compare_skins", {"predicted": HOLED}, "compare_skins: 'predicted': 1 of"),
    ("compare_skins", {"actual": EMPTY}, "compare_skins: 'actual': the surface is empty"),
    ("compare_skins", {"landmarks": UNMARKED}, "'asis_left' is missing"),
    ("compare_skins", {"rotations": ({},)}, "'rotations' must have 2 members, not 1"),
    ("find_landmarks", {"bones": {}}, "bones: any of T1 to L5 is missing"),
    ("find_landmarks", {"bones": {"T7": HOLED}}, "find_landmarks: 'T7': 1 of"),
    ("fit_atlas", {"bones": {}}, "fit_atlas: 'bones' is empty"),
    ("fit_atlas", {"drift": "square"}, "'drift' must be linear or constant, not 'square'"),
    ("fit_atlas", {"nugget": np.nan}, "'nugget' must be 0 to"),
    ("fit_back", {"points": np.zeros((5, 2))}, "fit_back: 'points' must be numbers of shape (n, 3), not (5, 2)"),
    ("fit_back", {"markers": UNMARKED}, "markers: needs C7"),
    ("make_case", {"bones": {}}, "bones: any of T1 to L5 is missing"),
    ("make_case", {"correction": np.nan}, "make_case: 'correction' must be a number from 0 to 1, not nan"),
    ("measure", {"skin": HOLED}, "measure: 'skin': 1 of 3578 vertices"),
    ("measure", {"before": HOLED}, "measure: 'before': 1 of 3578 vertices"),
    ("measure", {"unseen": np.zeros(3)}, "measure: 'unseen' must have the shape (3578,)"),
    ("measure_back", {"back": np.zeros((4, 2))}, "'back' must be numbers of shape (n, 3), not (4, 2)"),
    ("measure_back", {"back": HOLED}, "measure_back: 'back': 1 of 3578 vertices"),
    ("measure_back", {"spine": [[np.nan] * 3]}, "'spine' must be numbers of shape (n, 3), all finite"),
    ("patient_of", {"case": wt.Case("a", HOLED, BONES, MARKS)}, "skin: 1 of 3578 vertices are not finite"),
    ("patient_of", {"case": wt.Case("a", SKIN, {}, MARKS)}, "'bones' is empty"),
    ("phantom_case", {"correction": -1.0}, "phantom_case: 'correction' must be a number from 0"),
    (
        "plan_surgery",
        {"case": wt.Case("a", SKIN, BONES, UNMARKED)},
        "a plan needs at least 2 vertebrae",
    ),
    ("read_landmarks", {"units": "ft"}, "read_landmarks: 'units' must be mm or cm or m or in, not 'ft'"),
    ("read_landmarks", {"columns": ("name",)}, "'columns' must have 4 members, not 1"),
    ("register_skin", {"skin": HOLED}, "register_skin: 'skin': 1 of"),
    ("register_skin", {"on_skin": UNMARKED}, "register_skin: 'on_skin' is empty"),
    ("simulate", {"plan": []}, "simulate: there is no plan"),
    ("simulate", {"plan": {}}, "simulate: there is no plan"),
    ("simulate", {"plan": ["T4"]}, "simulate: 'plan[0]' must be of type Plan, not 'T4'; give wt.Plan("),
    ("simulate", {"execution": wt.Execution(device="gpu")}, "device: 'gpu' is not on this machine"),
    ("write_surface", {"path": "skin.foo"}, "a surface cannot be written as '.foo'"),
    ("write_surface", {"surface": EMPTY}, "'surface': the surface is empty"),
    ("write_surface", {"space": "XYZ"}, "'space' must be LPS or RAS, not 'XYZ'"),
    ("Axes", {"code": "XYZ"}, "axes: a code has one letter of L R"),
    ("Bound", {"low": np.nan}, "--within T8: 'low' must be a number from 0 to 1, not nan"),
    ("Bound", {"low": 0.7}, "must go from a smaller share to a larger one"),
    ("Bound", {"target": "cobb"}, "'target' must be correction or derotation, not 'cobb'"),
    ("Case", {"posture": "lying"}, "case: 'posture' must be standing or supine or prone, not 'lying'"),
    ("Case", {"bones": {"T1": None}}, "case: 'bones[T1]' must be of type Surface, not None"),
    ("CutPlane", {"point": (1.0, 2.0)}, "cut: 'point' must have 3 members, not 2"),
    ("CutPlane", {"point": (1.0, 2.0, np.nan)}, "cut: a plane is a point"),
    ("Execution", {"threads": -1}, "execution: 'threads' must be a number from 0"),
    ("Landmarks", {"points": [[1, 2]]}, "landmarks: 'points' must be numbers of shape (n, 3), not (1, 2)"),
    ("Landmarks", {"points": [[1, 2, 3], [1, 2]]}, "its rows differ in length"),
    ("Landmarks", {"points": [[1, 2, np.nan]]}, "all finite, but number 0 is [1.0, 2.0, nan]"),
    ("Landmarks", {"names": ("a", "b")}, "must have a row for each name, not 1 for 2 names"),
    ("Landmarks", {"names": "a"}, "'names' must be a list, not 'a'"),
    ("Landmarks", {"names": (7,)}, "'names[0]' must be a text, not 7"),
    ("Layers", {"skin_thickness": np.nan}, "layers: 'skin_thickness' must be from 0 to 200 mm, not nan"),
    ("Layers", {"constants": {"bone": {}}}, "layers: there is no layer 'bone'"),
    ("Layers", {"constants": {"fat": {"colour": 1.0}}}, "unknown key 'layers.fat.colour'"),
    ("MeshOptions", {"tets": 110000.0}, "mesh: 'tets' must be a whole number, not 110000.0; give 110000"),
    ("MeshOptions", {"tets": -1}, "mesh: 'tets' must be a number from 4 to 5e+07, not -1; the nearest is 4"),
    ("Motion", {"translation": (1.0, 2.0)}, "motion: 'translation' must have 3 members, not 2"),
    ("PatientSpine", {"line": [[0.0, np.nan, 0.0]]}, "spine: 'line' must be numbers of shape (n, 3), all finite"),
    ("Plan", {"curves": wt.CurvePlan("T8")}, "'curves' must be a list, not CurvePlan; give a list of it"),
    ("Plan", {"liv": ""}, "plan: 'liv' is missing"),
    ("Plan", {"unfused": "foo"}, "plan: 'unfused' must be follow or fixed, not 'foo'"),
    ("RelaxOptions", {"tolerance": np.nan}, "'tolerance' must be a finite number of at least 0 mm, not nan"),
    ("RunOptions", {"constants": {"poisson": 0.3}}, "there is no constant 'poisson'"),
    ("RunOptions", {"bands": "yes"}, "options: 'bands' must be True or False, not 'yes'"),
    ("RunOptions", {"precision": "double"}, "'precision' must be float32 or float64"),
    ("SimulationOptions", {"increments": 2.0}, "simulation: 'increments' must be a whole number, not 2.0; give 2"),
    ("SpineCurve", {"cobb": np.nan}, "curve: 'cobb' must be a number from 0 to 120 degrees, not nan"),
    ("StraightBody", {"psis": [[1.0, 2.0, 3.0]]}, "body: 'psis' must be numbers of shape (2, 3), not (1, 3)"),
    ("Study", {"months_after": -1.0}, "study: 'months_after' must be a number from 0"),
    ("Surface", {"faces": [[0, 1, 2.5]]}, "surface: 'faces' must be whole numbers of shape (n, 3)"),
    (
        "Surface",
        {"colours": np.zeros((5, 3), np.uint8)},
        "must have a row for each vertex, not 5 for 3578",
    ),
    ("Tissue", {"density": np.nan}, "tissue: 'density' must be a finite number of at least 1e-09 kg/m^3, not nan"),
    ("Tissue", {"youngs_modulus": "a"}, "tissue: 'youngs_modulus' must be a number, not 'a'"),
    ("Uncertainty", {"epsilon": 0.5}, "uncertainty: 'epsilon' must be a number from 1"),
]


@pytest.mark.parametrize(("name", "wrong", "said"), BAD, ids=[f"{name} {said}" for name, _, said in BAD])
def test_a_value_that_cannot_be_used_is_refused_in_one_line(name: str, wrong: dict[str, Any], said: str) -> None:
    with refuses(said):
        getattr(wt, name)(**(GOOD | RECORDS)[name] | wrong)


READERS = [
    "read_case",
    "read_landmarks",
    "read_motions",
    "read_plan",
    "read_result",
    "read_surface",
    "view_result",
]
PATHS = {"a missing file": "none/at.all", "a folder": "folder", "an empty file": "empty"}


@pytest.mark.parametrize("what", PATHS)
@pytest.mark.parametrize("reader", READERS)
def test_a_path_that_holds_nothing_to_read_is_named(reader: str, what: str, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "empty").touch()
    if (reader, what) == ("read_motions", "an empty file"):
        assert wt.read_motions(tmp_path / "empty") == {}
        return
    path = tmp_path / PATHS[what]
    with refuses(begins=path):
        getattr(wt, reader)(path)
    if what == "a missing file":
        with pytest.raises(FileNotFoundError):
            getattr(wt, reader)(str(path))


@pytest.mark.parametrize(
    ("write", "name"), [("write_case", "file"), ("write_plan", "folder"), ("write_surface", "folder.ply")]
)
def test_a_place_that_cannot_be_written_is_named(write: str, name: str, tmp_path: Path) -> None:
    for folder in ("folder", "folder.ply"):
        (tmp_path / folder).mkdir()
    (tmp_path / "file").touch()
    arguments = list(GOOD[write].values())
    with refuses(begins=tmp_path / name):
        getattr(wt, write)(tmp_path / name, arguments[1])
    if write != "write_case":
        with pytest.raises(MissingFileError):
            getattr(wt, write)(tmp_path / "none" / "skin.ply", arguments[1])


def test_lists_become_arrays_of_the_stated_numbers() -> None:
    marks = wt.Landmarks(["a", "b"], [[0, 0, 1], [2, 3, 4]])
    surface = wt.Surface([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    assert marks.names == ("a", "b")
    assert [array.dtype.name for array in (marks.points, surface.vertices, surface.faces)] == [
        "float64", "float64", "int32"
    ]  # fmt: skip
    assert wt.RunOptions(from_mesh="mesh.vtu").from_mesh == Path("mesh.vtu")


def test_what_a_reader_sees_of_records_is_a_line_each(tmp_path: Path) -> None:
    """Of a case, a skin, landmarks, a result, its measures and its summary."""
    result = wt.read_result(write_small_result(tmp_path))
    shown = [repr(record) for record in (CASE, SKIN, MARKS, result, result.measures, result.summary)]
    assert all(len(line) <= 300 for line in shown), [len(line) for line in shown]
    assert repr(CASE).startswith("Case(")
    assert "7 bones" in repr(CASE)


def test_every_field_of_a_record_is_checked() -> None:
    """Each class of records calls the check of all of its fields."""
    assert all(
        len(fields(getattr(wt, name))) > 0 and hasattr(getattr(wt, name), "__post_init__")
        for name in RECORDS
        if is_dataclass(getattr(wt, name))
    )

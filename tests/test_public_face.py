"""Every public function and record refuses what it cannot take: one line that names the argument, before any work.

A public function without a row in `GOOD`, and a public record without one in `RECORDS`, fails.
"""

import inspect
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import warp_trunk
from support.asserting import refuses
from support.report_results import write_small_result
from support.shown import check_shown
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


BAD: dict[str, list[dict[str, Any]]] = {
    "best_plan": [{"aim": "foo"}, {"within": []}, {"within": "T8,correction=0.4..0.6"}, {"most": 0}],
    "close_skin": [{"parts": {}}, {"parts": {"scan": HOLED}}],
    "compare_skins": [{"predicted": HOLED}, {"actual": EMPTY}, {"landmarks": UNMARKED}, {"rotations": ({},)}],
    "find_landmarks": [{"bones": {}}, {"bones": {"T7": HOLED}}],
    "fit_atlas": [{"bones": {}}, {"drift": "square"}, {"nugget": np.nan}],
    "fit_back": [{"points": np.zeros((5, 2))}, {"markers": UNMARKED}],
    "make_case": [{"bones": {}}, {"correction": np.nan}],
    "measure": [{"skin": HOLED}, {"before": HOLED}, {"unseen": np.zeros(3)}],
    "measure_back": [{"back": np.zeros((4, 2))}, {"back": HOLED}, {"spine": [[np.nan] * 3]}],
    "patient_of": [{"case": wt.Case("a", HOLED, BONES, MARKS)}, {"case": wt.Case("a", SKIN, {}, MARKS)}],
    "phantom_case": [{"correction": -1.0}],
    "plan_surgery": [{"case": wt.Case("a", SKIN, BONES, UNMARKED)}],
    "read_landmarks": [{"units": "ft"}, {"columns": ("name",)}],
    "register_skin": [{"skin": HOLED}, {"on_skin": UNMARKED}],
    "simulate": [{"plan": []}, {"plan": {}}, {"plan": ["T4"]}],
    "write_surface": [{"path": "skin.foo"}, {"surface": EMPTY}, {"space": "XYZ"}],
    "Axes": [{"code": "XYZ"}],
    "Bound": [{"low": np.nan}, {"low": 0.7}, {"target": "cobb"}],
    "Case": [{"posture": "lying"}, {"bones": {"T1": None}}],
    "CutPlane": [{"point": (1.0, 2.0)}, {"point": (1.0, 2.0, np.nan)}],
    "Execution": [{"threads": -1}],
    "Landmarks": [{"points": [[1, 2]]}, {"points": [[1, 2, 3], [1, 2]]}, {"points": [[1, 2, np.nan]]},
        {"names": ("a", "b")}, {"names": "a"}, {"names": (7,)}],
    "Layers": [{"skin_thickness": np.nan}, {"constants": {"bone": {}}},
        {"constants": {"fat": {"colour": 1.0}}}],
    "MeshOptions": [{"tets": 110000.0}, {"tets": -1}],
    "Motion": [{"translation": (1.0, 2.0)}],
    "PatientSpine": [{"line": [[0.0, np.nan, 0.0]]}],
    "Plan": [{"curves": wt.CurvePlan("T8")}, {"liv": ""}, {"unfused": "foo"}],
    "RelaxOptions": [{"tolerance": np.nan}],
    "RunOptions": [{"constants": {"poisson": 0.3}}, {"bands": "yes"}, {"precision": "double"}],
    "SimulationOptions": [{"increments": 2.0}],
    "SpineCurve": [{"cobb": np.nan}],
    "StraightBody": [{"psis": [[1.0, 2.0, 3.0]]}],
    "Study": [{"months_after": -1.0}],
    "Surface": [{"faces": [[0, 1, 2.5]]}, {"colours": np.zeros((5, 3), np.uint8)}],
    "Tissue": [{"density": np.nan}, {"youngs_modulus": "a"}],
    "Uncertainty": [{"epsilon": 0.5}],
}  # fmt: skip
"""Values that each takes in place of a good one, and refuses."""


def refusals() -> Iterator[str]:
    """The line with which each is refused."""
    for name, every in BAD.items():
        for wrong in every:
            with pytest.raises(InputError) as error:
                getattr(wt, name)(**(GOOD | RECORDS)[name] | wrong)
            assert "\n" not in str(error.value)
            yield f"{name} {[*wrong]}: {error.value}"


def test_values_that_cannot_be_used_are_refused_in_one_line_as_accepted() -> None:
    check_shown("refused_values", refusals())


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

"""The examples of the public names run, and so does the notebook of the documentation."""

import dataclasses
import doctest
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

import warp_trunk as wt
from support.blocks import spine_and_hips
from support.phantoms import coarse_mesh, coarse_phantom
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.report.writing import notebook_html

SMALL = wt.RunOptions(mesh=coarse_mesh(), simulation=wt.SimulationOptions(increments=1))


@pytest.fixture(scope="module")
def shared() -> dict[str, Any]:
    """The names that examples use; the coarse phantom is simulated once for all of them."""
    case = coarse_phantom()
    return {
        "wt": wt, "np": np, "dataclasses": dataclasses, "case": case, "small": SMALL, "skin": straight_trunk()[0],
        "result": wt.simulate(case, None, SMALL, wt.Execution(record=False)), "bones": spine_and_hips(),
    }  # fmt: skip


LONG = {
    "StraightBody", "best_plan", "close_skin", "find_landmarks", "fit_back", "make_case", "simulate",
    "write_report",
}  # fmt: skip
"""Examples that take long, which run with the slow tests."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in LONG else name for name in wt.__all__]
)
def test_example_of_every_public_name(
    name: str, shared: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(wp.config, "log_level", wp.LOG_WARNING)  # what loading prints is no output
    names = {**shared, "folder": tmp_path}
    (example,) = doctest.DocTestFinder(recurse=False).find(getattr(wt, name), name, globs=names)
    assert example.examples, "has no example"
    runner = doctest.DocTestRunner(optionflags=doctest.IGNORE_EXCEPTION_DETAIL)
    assert runner.run(example).failed == 0


@pytest.mark.slow
def test_notebook_of_the_documentation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its cells run in order; what the last line of a cell shows is asked for as a notebook does."""
    monkeypatch.chdir(tmp_path)
    notebook = json.loads((Path(__file__).parents[1] / "docs/first_simulation.ipynb").read_text(encoding="utf-8"))
    names: dict[str, Any] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            exec("".join(cell["source"]), names)
    assert names["result"].converged
    assert notebook_html(names["result"]).count("<img") == 1
    assert (tmp_path / "results/first/report.html").is_file()

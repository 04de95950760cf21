"""Every warning, and how a run ended, on the console, in the summary, in the report and in the recording."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.drawn import Page, drawn_figures
from support.rrd import column
from support.small_trunk import boned_case
from warp_trunk.cli import main
from warp_trunk.engine.relaxation import RelaxOptions, RelaxStatus
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.io.trunk_file import write_trunk
from warp_trunk.results.summary_text import plain
from warp_trunk.run import simulate as running
from warp_trunk.run import warnings
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.prediction import Prediction

SOURCES = sorted(name for name in vars(warnings) if name.endswith("_warnings"))
"""Each is called by a run, and gives sentences."""
EVERYWHERE = {
    **{name: f"A sentence of {name}." for name in SOURCES},
    "the check of the case": "A sentence of the check of the case.",
    "the quality of the skin": "The predicted skin is stretched to more than 1.35 times its length over",
}


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The outputs of a run with every warning, tetrahedra inside out and nodes that came off the bones."""
    folder, relax = tmp_path_factory.mktemp("ended"), Prediction.relax

    def inside_out(prediction: Prediction, *observers: Any, **options: Any) -> Prediction:
        relax(prediction, *observers, **options)
        last = prediction.increments[-1]
        last.relaxation = replace(last.relaxation, inverted_tets=3)
        above = np.maximum(prediction.trunk.nodes[:, 2:] - 280.0, 0.0)
        last.displacement = last.displacement + above * [0.0, 0.0, 0.6]  # stretched
        prediction.released = 5
        return prediction

    case, trunk = boned_case()
    write_trunk(folder / "mesh.vtu", trunk)
    options = RunOptions(
        from_mesh=folder / "mesh.vtu",
        simulation=SimulationOptions(increments=1, relax=RelaxOptions(tolerance=0.5)),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Prediction, "relax", inside_out)
        for name in SOURCES:
            patch.setattr(running, name, lambda *_, name=name, **__: [EVERYWHERE[name]])
        checked = [EVERYWHERE["the check of the case"]]
        execution = Execution(device="cpu", threads=1)
        result = running.simulate(case, None, options, execution, folder=folder / "out", warnings=checked)
    with drawn_figures():
        assert main(["report", str(folder / "out")]) == 0
    summary = (folder / "out" / "summary.json").read_text(encoding="utf-8")
    return {
        "console": plain(result),
        "summary": " ".join(json.loads(summary)["warnings"]),
        "report": Page((folder / "out" / "report.html").read_text(encoding="utf-8")).words,
        "recording": column(folder / "out" / "recording.rrd", "/summary", "text")[None].item(),
        "whole summary": summary,
    }


@pytest.mark.parametrize("source", EVERYWHERE)
@pytest.mark.parametrize("place", ["console", "summary", "report", "recording"])
def test_every_warning_is_shown_everywhere(ended: dict[str, str], source: str, place: str) -> None:
    assert EVERYWHERE[source] in ended[place]


def test_tetrahedra_inside_out_and_nodes_off_the_bones_are_counted(ended: dict[str, str]) -> None:
    summary = json.loads(ended["whole summary"])
    assert (summary["inverted_tets"], summary["released_nodes"]) == (3, 5)
    assert "3 of them inverted" in ended["console"]
    assert "Inverted tetrahedra at the end: 3; nodes that came off the bones for it: 5." in ended["report"]


def test_the_end_of_a_run_that_took_all_its_steps_is_advised_of(tmp_path: Path) -> None:
    case, trunk = boned_case()
    write_trunk(tmp_path / "mesh.vtu", trunk)
    steps = SimulationOptions(increments=1, relax=RelaxOptions(tolerance=1e-5, max_steps=1))
    options = RunOptions(bones="spline", from_mesh=tmp_path / "mesh.vtu", simulation=steps)
    execution = Execution(device="cpu", threads=1, record=False)
    result = running.simulate(case, None, options, execution, folder=tmp_path / "out", warnings=())
    assert result.status is RelaxStatus.STEP_LIMIT
    assert any("took the most steps allowed" in text for text in result.summary.warnings)
    assert "took the most steps allowed" in plain(result)

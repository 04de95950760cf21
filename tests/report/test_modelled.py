"""Options and what was modelled, in words."""

import inspect
import re

import pytest

from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.engine.tissue import Tissue
from warp_trunk.meshing import MeshOptions
from warp_trunk.report.modelled import UNITS, option_rows, value_text
from warp_trunk.run.options import RunOptions, parameters


def test_units_are_those_of_the_documentation() -> None:
    found = {}
    for kind in (RunOptions, MeshOptions, SimulationOptions, RelaxOptions, Tissue):
        fields = re.findall(r'^    (\w+): [^\n]*\n    """([^"]*)"""', inspect.getsource(kind), re.MULTILINE)
        found |= {name: unit[1] for name, text in fields if (unit := re.search(r"\[([a-zA-Z][^\]]*)\]", text))}
    for table in ("layers", "bones", "bands"):  # [layers], [ribs], [uncertainty] are tables of case.toml
        del found[table]
    assert found == UNITS


def test_every_option_has_a_row_in_words() -> None:
    rows = dict(option_rows(parameters(RunOptions(skin_rigidity=0.4))))
    assert rows["tolerance"] == "0.1 mm"
    assert rows["skin rigidity"] == "0.4 N mm"
    assert rows["tets"] == "225000"
    assert rows["cache"] == "yes"
    assert len(rows) == len(parameters(RunOptions()))


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (None, "mm", "–"),
        ([], "", "–"),
        (["distance", "energy"], "", "distance, energy"),
        (False, "", "no"),
        (9.81, "m/s^2", "9.81 m/s²"),
        ("3.11.7", "", "3.11.7"),
    ],
)
def test_a_value_is_written_for_readers(value: object, unit: str, text: str) -> None:
    assert value_text(value, unit) == text

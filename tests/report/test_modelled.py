"""Options and what was modelled, in words."""

import inspect
import re

from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.engine.tissue import Tissue
from warp_trunk.meshing import MeshOptions
from warp_trunk.report.modelled import UNITS, option_rows
from warp_trunk.run.options import RunOptions


def test_units_are_those_of_the_documentation() -> None:
    found = {}
    for kind in (RunOptions, MeshOptions, SimulationOptions, RelaxOptions, Tissue):
        fields = re.findall(r'^    (\w+): [^\n]*\n    """([^"]*)"""', inspect.getsource(kind), re.MULTILINE)
        found |= {name: unit[1] for name, text in fields if (unit := re.search(r"\[([a-zA-Z][^\]]*)\]", text))}
    for table in ("layers", "bones", "bands"):  # [layers], [ribs], [uncertainty] are tables of case.toml
        del found[table]
    assert found == UNITS


def test_values_are_written_for_readers() -> None:
    given = {
        "gravity": 9.81,
        "weights": None,
        "terms": ["distance", "energy"],
        "cache": False,
        "skin_rigidity": 0.4,
    }
    texts = ["9.81 m/s²", "–", "distance, energy", "no", "0.4 N mm"]
    names = ["gravity", "weights", "terms", "cache", "skin rigidity"]
    assert option_rows(given) == list(zip(names, texts, strict=True))

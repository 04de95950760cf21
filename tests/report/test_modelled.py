"""Options and what was modelled, in words."""

import inspect
import re

from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.engine.tissue import Tissue
from warp_trunk.meshing import MeshOptions
from warp_trunk.report.modelled import UNITS
from warp_trunk.run.options import RunOptions


def test_units_are_those_of_the_documentation() -> None:
    found = {}
    for kind in (RunOptions, MeshOptions, SimulationOptions, RelaxOptions, Tissue):
        fields = re.findall(r'^    (\w+): [^\n]*\n    """([^"]*)"""', inspect.getsource(kind), re.MULTILINE)
        found |= {name: unit[1] for name, text in fields if (unit := re.search(r"\[([a-zA-Z][^\]]*)\]", text))}
    for table in ("layers", "bones", "bands"):  # [layers], [ribs], [uncertainty] are tables of case.toml
        del found[table]
    assert found == UNITS

"""Predicts how the trunk of a scoliosis patient looks after spine surgery.

    import warp_trunk as wt

    case = wt.read_case("patient")
    plan = wt.Plan(uiv="T4", liv="L1", curves=[wt.CurvePlan("T8", correction=0.65, derotation=0.4)])
    result = wt.simulate(case, plan, wt.RunOptions(bands=True))
    result.skin, result.measures, result.to_rows()
    result.save("results/t4_l1")
    wt.write_report(result)

The public names are listed in `__init__.pyi`; each is imported from its package when it is first used, so that
`import warp_trunk` costs nothing. The example in the documentation of each is run as a test; there `case` is
`wt.phantom_case()`, `small` are options of a small mesh, `result` is `wt.simulate(case, options=small)`, `skin`
and `bones` are a straight trunk, and `folder` is an empty folder.

Experts import more from the packages: `engine` (`Model`, `Relaxer`, and the increments one by one), `meshing`,
`bone_motion`, `run` (`prepare`, a `PreparedPatient` for many plans, `sensitivities`), `measures`, `preparation`.
"""

import sys
from typing import Any

import lazy_loader

__version__ = "0.1.0"
"""The version of the package; pyproject.toml reads it here."""
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def _notebook_html(result: Any) -> str:
    from .report.writing import notebook_html  # draws

    return notebook_html(result)


if "IPython" in sys.modules and (shell := sys.modules["IPython"].get_ipython()) is not None:
    html = shell.display_formatter.formatters["text/html"]
    html.for_type_by_name("warp_trunk.results.result", "Result", _notebook_html)

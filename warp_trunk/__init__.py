"""Predicts how the trunk of a scoliosis patient looks after spine surgery.

    import warp_trunk as wt

    case = wt.read_case("patient")
    plan = wt.Plan(uiv="T4", liv="L1", curves=[wt.CurvePlan("T8", correction=0.65, derotation=0.4)])
    result = wt.simulate(case, plan, bands=True)
    result.skin, result.measures, result.to_rows()
    result.save("results/t4_l1")
    result.report()

The public names are listed in `__init__.pyi`; each is imported from its package when it is first used, so that
`import warp_trunk` costs nothing. The example in the documentation of each is run as a test; there `case` is
`wt.phantom_case()`, `result` is `wt.simulate(case)`, `skin` and `bones` are a straight trunk, and `folder` is an
empty folder.

Experts import more from the packages: `engine` (`Model`, `Relaxer`, and the increments one by one), `meshing`,
`bone_motion`, `run` (`prepare`, a `PreparedPatient` for many plans, `sensitivities`), `measures`, `preparation`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

"""How ribs go after surgery, three ways, on virtual patients, against what the clinic published.

    python scripts/compare_ribs.py ANATOMY                              the tables
    python scripts/compare_ribs.py ANATOMY --page docs/ribs.md          into the page, between their marks
    python scripts/compare_ribs.py ANATOMY --energy itmsm               all with one energy: how bars are met
    python scripts/compare_ribs.py WHOLE --called whole --tets 225000   with shoulder blades: tables of their own
    python scripts/compare_ribs.py ANATOMY --flank docs/ribs_flank.png  a picture; --cage another

ANATOMY holds skin.ply and bones/ of a straight trunk, as for make-case. Curves are imposed on it and parts of them
corrected. Each plan is simulated with bones that the spline carries, with ribs that follow by shares, and with all
bones known after surgery (those of the trunk on which the corrected curve is imposed, each rigidly). The tables
tell the change of back surface rotation (BSR) at the level where it was largest, over that of the Cobb angle (0.58
for the hump in Mattila et al. 2013), what 5 degrees less of derotation at the same Cobb angle change, how smooth
the skin stays, the work, how each bar is met in all plans, how far the skin lies from that of the trunk on which
the corrected curve is imposed, and what other shares change at each level. Rows are
kept in a folder, so that it goes on where it was stopped, and several processes can share the work; delete the
folder when a model has changed.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from itertools import product
from pathlib import Path

from benchmarking.process import be_quiet
from marked import replaced, write_into
from ribs.pictures import draw_cage, draw_flank
from ribs.rows import Distance, Row, Shoulders, Smoothness
from ribs.study import CORRECTIONS, PATIENTS, SHOWN, WAYS, Study, Way, moved
from ribs.tables import by_bar, by_patient, by_share, by_truth, imposed

from warp_trunk.case.rib_shares import RANGES, RibShares
from warp_trunk.engine.energies.by_name import ENERGIES
from warp_trunk.run.options import RunOptions

TOLD = {None: ("patients", "bars", "truth", "imposed", "shares"), "itmsm": ("bars",), "neo-hookean": ("bars",)}
"""The tables of each energy; None is what each way has when it is left out, itmsm with the spline."""


def main() -> None:
    """Simulates what is not kept yet, and tells or draws it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("anatomy", type=Path)
    parser.add_argument("--tets", type=int, default=130_000)
    parser.add_argument("--shares", default="{}", help='other shares of the ribs, such as {"recovery": 0.8}')
    parser.add_argument("--kept", type=Path, default=Path("results/ribs"), help="where rows are kept")
    parser.add_argument("--as-kept", action="store_true", help="tell the rows that are kept, simulate no other")
    parser.add_argument("--part", default="0/1", help="which part of the rows this process makes: 0/4 to 3/4")
    parser.add_argument("--page", type=Path, help="the page whose tables are written anew")
    parser.add_argument("--cage", type=Path, help="draw the cage into this file, and simulate nothing")
    parser.add_argument("--flank", type=Path, help="draw the skin of the flank into this file, and tell nothing")
    parser.add_argument("--energy", choices=ENERGIES, help="of the tissue, for every way")
    parser.add_argument("--called", default="", help="the anatomy's name in the marks of a page and of rows")
    given = parser.parse_args()
    be_quiet()
    study, shares = Study(given.anatomy, given.tets, given.energy), RibShares(**json.loads(given.shares))
    for draw, path in ((draw_cage, given.cage), (draw_flank, given.flank)):
        if path:
            draw(study, path)
    if given.cage or given.flank:
        return
    tables = ("patients", "bars", "truth") if given.called else TOLD[given.energy]
    if given.page:  # before any long work
        for name in tables:
            replaced(given.page.read_text(), _mark(name, study, given.called), "")
    given.kept /= given.called
    given.kept.mkdir(parents=True, exist_ok=True)
    number, parts = map(int, given.part.split("/"))
    plans = [plan for plan in product(PATIENTS, CORRECTIONS, WAYS) if plan[2] != "known" or plan[1] == SHOWN]
    rows = []
    for curve, correction, way in plans[number::parts]:
        name = f"{curve.kind}{curve.cobb:g}_{correction:g}_{way}{'' if way == 'spline' else _other(shares)}"
        name = f"{name}{_of(study, way)}"
        if not given.as_kept or (given.kept / f"{name}.json").is_file():
            rows.append(_kept(given.kept, name, partial(study.row, curve, correction, way, shares)))
    if parts > 1:
        return
    make_table = {
        "patients": partial(by_patient, rows),
        "bars": partial(by_bar, rows),
        "truth": partial(by_truth, rows),
        "imposed": partial(imposed, study),
        "shares": lambda: by_share(*_share_rows(study, given.kept, rows)),
    }
    for name in tables:
        table = make_table[name]()
        print(f"\n{table}")
        if given.page:
            write_into(given.page, _mark(name, study, given.called), table)


def _mark(name: str, study: Study, called: str) -> str:
    """Where a table stands in the page."""
    return ", ".join(part for part in (f"ribs {name}", study.energy, called) if part)


def _share_rows(study: Study, kept: Path, rows: list[Row]) -> tuple[dict[str, Row], Row]:
    """The thoracic curve of 60 degrees with each share at the ends of its range, and with the usual ones."""
    curve = PATIENTS[1]
    usual, spline = (
        next(row for row in rows if (row.patient, row.correction, row.way) == ("thoracic 60", SHOWN, way))
        for way in ("follow", "spline")
    )
    idle = {"direct"}  # screws force nothing in this plan
    if "scapula_left" not in study.bones:
        idle.add("scapula")
    found = {}
    for share, value in ((share, value) for share, ends in RANGES.items() for value in ends):
        other = replace(RibShares(), **{share: value})
        if other != RibShares() and share not in idle:
            name = f"share{_other(other)}{_of(study, 'follow')}"
            make = partial(study.row, curve, SHOWN, "follow", other, less=False)
            found[f"`{share}` {value:g}"] = _kept(kept, name, make)
    return found | {"spline instead of follow": spline}, usual


def _other(shares: RibShares) -> str:
    """The shares that are not the usual ones, for the name of a file."""
    usual = asdict(RibShares())
    return "".join(f"_{name}{value:g}" for name, value in asdict(shares).items() if value != usual[name])


def _of(study: Study, way: Way) -> str:
    """Mesh and energy, for the name of a file."""
    return f"_{study.tets}_{moved(way, RunOptions(energy=study.energy)).energy_of_tissue}"


def _kept(folder: Path, name: str, make: Callable[[], Row]) -> Row:
    """The row of a file, made where it is not there."""
    path = folder / f"{name}.json"
    if not path.is_file():
        making = path.with_suffix(f".{os.getpid()}")
        making.write_text(json.dumps(asdict(make())))
        os.replace(making, path)
    entries = json.loads(path.read_text())
    parts = {"smooth": Smoothness, "shoulders_before": Shoulders, "shoulders_after": Shoulders}
    parts |= {"truth_before": Distance, "truth_after": Distance}
    row = Row(**entries | {name: kind(**entries[name]) for name, kind in parts.items()})
    print(f"{name}: {row.status}, {row.over_cobb:.2f}", flush=True)
    return row


if __name__ == "__main__":
    main()

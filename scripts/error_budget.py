"""What every choice costs, in mm of the back and degrees of its rotation: the error budget of a prediction.

    python scripts/error_budget.py CASE --out docs/error_budget

Each row is a run that differs in one choice from the default one, or from the one its label names; errors of
landmarks and bones are drawn several times. Prints a table, writes a page, a JSON and a picture. Runs are kept
in a folder, so that it goes on where it was stopped; delete the folder when the engine has changed.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from benchmarking.prepare import load_case
from benchmarking.process import be_quiet
from choices.budget import measured, table
from choices.budget_picture import draw_budget
from choices.errors import BONE_MEAN
from choices.rows import Row, rows
from choices.study import Study

PAGE = """# What every choice costs: {case}

![Bars of the table below]({picture})

Made by `scripts/error_budget.py`. Each row is a run that differs in one choice from the default run, or from
what its label names. All skins have the same vertices; mm are distances between the two places of a point of
the back (what faces back from T1 to L5), averaged by area and largest; degrees are the largest difference of
the back surface rotation of any level from T1 to L5. A surgeon can detect 2.5 degrees (section 4.5 of [2]).

Random errors are those the papers state of their reconstruction from radiographs; the table has their mean +-
standard deviation over the samples, and the 95th percentile. *Before and after*: each landmark of both
reconstructions has an error of its own, in any direction, as where a prediction is judged by what came after.
*The plan by the same*: the plan moves the vertebrae that were found, so that errors go along with them.
*Bones*: each is displaced by a smooth random field of its own, {bone:g} mm long in the mean; landmarks stay, and
the trunk is meshed anew, which by itself costs what *meshed anew* says. *The papers' way*: `--bones spline`.

{table}"""


def main() -> None:
    """Simulates, compares, draws and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", help="a case folder, or phantom")
    parser.add_argument("--threads", type=int, default=0, help="0 is all cores")
    parser.add_argument("--landmark-samples", type=int, default=20)
    parser.add_argument("--bone-samples", type=int, default=6)
    parser.add_argument("--kept", type=Path, default=Path("results/choices"), help="where runs are kept")
    parser.add_argument("--out", type=Path, default=Path("docs/error_budget"), help="name without its ending")
    given = parser.parse_args()
    be_quiet()
    study = Study(load_case(given.case), given.kept, given.threads)
    write_budget(study, rows(given.landmark_samples, given.bone_samples), given.out)


def write_budget(study: Study, varied: Sequence[Row], out: Path) -> None:
    """Measures each row, and writes `out` with the endings .json, .png and .md."""
    costs = [measured(study, row) for row in varied]
    costs.sort(key=lambda cost: -cost.bsr_deg)
    out.parent.mkdir(parents=True, exist_ok=True)
    record = {"case": study.case.name, "rows": [asdict(cost) for cost in costs]}
    out.with_suffix(".json").write_text(json.dumps(record, indent=1, allow_nan=False) + "\n")
    draw_budget(out.with_suffix(".png"), costs)
    text = table(costs)
    page = PAGE.format(case=study.case.name, picture=f"{out.name}.png", bone=BONE_MEAN, table=text)
    out.with_suffix(".md").write_text(page, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()

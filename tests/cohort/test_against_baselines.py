"""A method that is worse than doing nothing says so first: three patients, lumbar errors by hand."""

from __future__ import annotations

from pathlib import Path

from warp_trunk.cohort.page import over_whole_back, worse_parts
from warp_trunk.cohort.rows import CaseRow, LevelRow
from warp_trunk.cohort.summary import summarize_cohort
from warp_trunk.cohort.tables import cohort_text, write_cohort

ROWS = [
    CaseRow(
        folder=f"P{number}",
        status="CONVERGED",
        patient=f"P{number}",
        levels=(
            LevelRow(level="T8", before=9.0, predicted=5.0 + 0.1 * number, spline=6.0, actual=5.0),
            LevelRow(level="L2", before=-3.0, predicted=-4.0 - number, spline=-9.0, actual=-2.0),
        ),
    )
    for number in (1, 2, 3)
]
"""Lumbar errors are 3, 4 and 5, 1 if nothing changed, 7 by the spline; thoracic ones 0.1, 0.2 and 0.3, 4, 1."""
LUMBAR = (
    "The lumbar back (L1-L5) is predicted worse than by saying that nothing changes: the error is 4.00 degrees, "
    "not 1.00; the difference is 3.00 (95 % interval 2.00 to 4.00)."
)


def test_the_part_that_is_worse_is_said_with_figures() -> None:
    assert worse_parts(summarize_cohort(ROWS)) == [LUMBAR]
    assert worse_parts(summarize_cohort(ROWS[:2]))[0].endswith(
        "the difference is 2.50; fewer than three patients do not show whether that holds for others."
    )


def test_the_whole_back_is_told_against_both() -> None:
    """Errors 1.55, 2.10 and 2.65 against 2.5 and 4: gains 0.95, 0.40, -0.15 and 2.45, 1.90, 1.35."""
    nothing, spline = over_whole_back(summarize_cohort(ROWS))
    assert nothing == (
        "The error is 0.40 degrees smaller than by saying that nothing changes (95 % interval -0.15 to 0.95; it "
        "holds 0, so these patients do not show it)."
    )
    assert spline.startswith("The error is 1.90 degrees smaller than by moving the skin with the spline")


def test_page_and_terminal_say_it_before_any_table(tmp_path: Path) -> None:
    summary = write_cohort(tmp_path, ROWS)
    page = (tmp_path / "cohort.html").read_text()
    assert page.index("predicted worse than by saying that nothing changes") < page.index("<table")
    assert LUMBAR in cohort_text(summary)

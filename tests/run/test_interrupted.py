"""Runs that are killed: they leave nothing half-written, and the next run is not disturbed."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

MOMENTS = int(os.environ.get("WARP_TRUNK_KILLS", "4"))
"""Moments at which a run is killed; every move of a file is one more."""


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[dict]:
    """Findings on every killed run, see killed_runs.py."""
    folder = tmp_path_factory.mktemp("killed")
    done = subprocess.run(
        [sys.executable, "-m", "support.killed_runs", str(folder), str(MOMENTS)],
        cwd=Path(__file__).parents[1],
        capture_output=True,
        encoding="utf-8",
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_runs_were_killed_while_they_worked_and_while_they_wrote(rows: list[dict]) -> None:
    moves = [row for row in rows if row["kind"] == "move"]
    assert len(rows) == len(moves) + MOMENTS
    assert all(row["ended"] == -9 for row in moves)
    assert max(len(row["files"]) for row in moves) == 6  # all but summary.json, which is the last


def test_no_half_written_file_bears_a_final_name(rows: list[dict]) -> None:
    assert [row for row in rows if row["half written"]] == []


def test_the_next_run_ends_as_one_that_was_not_killed(rows: list[dict]) -> None:
    """Skins, landmarks and trunk to the last bit, the summary but for times and memory."""
    assert [row for row in rows if row["next"] != 0 or row["different"]] == []


def test_nothing_is_left_over(rows: list[dict]) -> None:
    assert [row for row in rows if row["left over"]] == []

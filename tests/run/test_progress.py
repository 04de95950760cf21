"""The progress of a run, in a log and on a terminal."""

import io

import pytest

from support.small_trunk import made_up_increments, small_trunk
from warp_trunk.run.progress import Progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_log_has_one_line_for_each_stage_and_increment():
    stream = io.StringIO()
    with Progress(stream) as progress:
        with progress.stage("mesh", "meshing"):
            pass
        for increment in made_up_increments(small_trunk()[0], 2):
            progress.increment(increment, 2)
    lines = stream.getvalue().splitlines()
    assert len(lines) == 3
    assert lines[0].startswith("meshing: ")
    assert lines[2].startswith(
        "increment 2 of 2: CONVERGED, 0.004 mm from equilibrium, 4 steps, 100 linear iterations"
    )
    assert "\x1b" not in stream.getvalue()
    assert set(progress.seconds) == {"mesh"}


@pytest.mark.parametrize("kind", [io.StringIO, Terminal])
def test_of_several_works_every_line_says_of_which_it_is(kind):
    stream = kind()
    with Progress(stream) as progress:
        for name in ("plan short", "plan long"):
            with progress.of(name):
                progress.message("warning: far")
                with progress.stage("mesh", "meshing"):
                    pass
                for increment in made_up_increments(small_trunk()[0], 2):
                    progress.increment(increment, 2)
        progress.message("side by side")
    text = stream.getvalue()
    relaxing = "relaxing the tissue" if stream.isatty() else "increment 2 of 2"
    for name in ("plan short", "plan long"):
        assert all(f"{name}: {told}" in text for told in ("warning: far", "meshing", relaxing))
    assert "plan long: side by side" not in text

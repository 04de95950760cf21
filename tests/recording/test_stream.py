"""Writing that never holds a simulation up."""

from pathlib import Path

import pytest
import rerun as rr
import rerun.blueprint as rrb

from warp_trunk.recording.stream import open_streams


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_disk_that_is_full_from_the_start_leaves_the_simulation_alone(tmp_path, caplog):
    (tmp_path / "recording.rrd").symlink_to("/dev/full")
    (stream,) = open_streams("Anna", tmp_path / "recording.rrd", None, rrb.Blueprint())
    assert "No space left" in stream.failed
    assert "the simulation continues without it" in caplog.text
    stream.log("/a", rr.Clear(recursive=True), static=True)
    stream.close()

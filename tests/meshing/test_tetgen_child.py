"""TetGen runs in a process of its own, whose death is one line."""

import os
import subprocess
import sys

import pytest

from support.synthetic import sphere
from warp_trunk.errors import InputError
from warp_trunk.meshing.tetrahedra import tetrahedralize

SKIN, BONE = sphere(60.0), sphere(20.0)


@pytest.mark.parametrize(
    ("death", "said"),
    [
        ("kill -SEGV $$", "its process was ended by signal 11"),
        ("exit 3", "its process ended with status 3"),
        ("echo 'MemoryError: no room' >&2; exit 1", "MemoryError: no room"),
        ("", "its process ended with status 0"),
    ],
)
def test_its_death_is_one_line(monkeypatch, tmp_path, death, said):
    """In place of Python stands a program that dies as TetGen might."""
    dying = tmp_path / "dying"
    dying.write_text(f"#!/bin/sh\n{death}\n")
    dying.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(dying))
    with pytest.raises(InputError, match=rf"TetGen cannot fill the space between them \({said}\)") as error:
        tetrahedralize(SKIN, BONE, 3000)
    assert "\n" not in str(error.value)


def test_a_script_without_a_guard_can_mesh(tmp_path):
    script = (
        "from support.synthetic import sphere; from warp_trunk.meshing.tetrahedra import tetrahedralize;"
        "print(len(tetrahedralize(sphere(60.0), sphere(20.0), 6000).tets))"
    )
    paths = os.pathsep.join(path for path in sys.path if path)
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, env={**os.environ, "PYTHONPATH": paths}, capture_output=True
    )
    assert done.returncode == 0, done.stderr
    assert 5100 <= int(done.stdout.split()[-1]) <= 6900
    assert list(tmp_path.iterdir()) == []

"""Memory and time that a number of tetrahedra takes."""

import pytest

from warp_trunk.cli import main
from warp_trunk.errors import InputError
from warp_trunk.run import size


def test_more_than_the_memory_is_refused_before_any_work(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(size, "memory_here", lambda: 4.5e9)
    assert main(["demo", "--tets", "5000000", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert "5000000 tetrahedra need about 5.5 GB of memory and 29 min" in said
    assert "this machine has 4.5 GB; ask for 4000000, or give --yes" in said
    assert not (tmp_path / "out").exists()
    assert "5.5 GB" in (size.check_size(5_000_000, go_on=True) or "")


def test_the_usual_number_says_nothing(monkeypatch):
    assert size.check_size(225_000) is None
    monkeypatch.setattr(size, "memory_here", lambda: 0.7e9)
    with pytest.raises(InputError, match="ask for 200000"):
        size.check_size(225_000)


def test_memory_is_known_here():
    assert 1e8 < size.memory_here() < 1e14

"""The command that a command proposes next can be pasted into a shell."""

import shlex
from pathlib import Path

import pytest

from warp_trunk.cli.output import next_command


@pytest.mark.parametrize(("under_uv", "start"), [(True, ["uv", "run", "warp-trunk"]), (False, ["warp-trunk"])])
def test_it_is_quoted_for_a_shell_and_starts_as_this_run_did(monkeypatch, under_uv: bool, start: list[str]):
    if under_uv:
        monkeypatch.setenv("UV_RUN_RECURSION_DEPTH", "1")
    else:
        monkeypatch.delenv("UV_RUN_RECURSION_DEPTH", raising=False)
    words = ["simulate", Path("Anna Müller") / "T4 & L1", "--out", "it's"]
    assert shlex.split(next_command(*words)) == [*start, *map(str, words)]
    assert next_command("view", "results/anna") == " ".join([*start, "view results/anna"])

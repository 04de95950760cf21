"""What a command says to type next is one that a shell takes."""

import shlex
from pathlib import Path

from warp_trunk.cli.next_command import next_command


def test_paths_with_spaces_and_signs_come_back_whole():
    words = ["simulate", Path("Anna Müller") / "T4 & L1", "--out", "it's"]
    assert shlex.split(next_command(*words)) == ["warp-trunk", *map(str, words)]


def test_a_plain_path_is_not_quoted():
    assert next_command("view", "results/anna") == "warp-trunk view results/anna"

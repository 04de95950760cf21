"""The words and files of commands, as lines of an accepted text."""

import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from support.refusals import row
from warp_trunk.cli import main


class Console:
    """Commands that were run in the folder of a test, and all that each printed."""

    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.folder, self.lines, self._capsys = folder, list[str](), capsys

    def run(self, words: str | Sequence[object]) -> int:
        """The exit status of a command."""
        arguments = words.split() if isinstance(words, str) else [str(word) for word in words]
        title = " ".join(arguments).replace(str(self.folder), "FOLDER").replace("\\", "/")
        with row(title):
            status = main(arguments)
        said = self._capsys.readouterr()
        self.lines.append(f"== {title}: status {status}")
        for name, text in (("", said.out), ("stderr: ", said.err)):
            for line in text.replace(str(self.folder), "FOLDER").replace("\\", "/").splitlines():
                if line.strip() and not re.search(r": [\d.]+ s$", line):
                    self.lines.append(f"{name}{line}")
        return status

    def file(self, name: str) -> None:
        """Notes the text of a file that a command wrote."""
        self.lines += [f"-- {name}", *(self.folder / name).read_text(encoding="utf-8").splitlines()]

"""Fixtures that tests of several rooms share. This folder is on the import path, for the package support in it."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read by NumPy once; workers of a run share the cores already

import pytest
from filelock import FileLock
from warp._src.context import Module  # Warp has no public hook for compilation

from support.refusals import plain_line, row
from support.report_results import write_small_result
from warp_trunk.cli import main
from warp_trunk.cli.output import BAD_INPUT


def pytest_configure() -> None:
    """Let one worker compile a module of kernels, while the others wait and load it from Warp's cache.

    Each worker keeps to its share of the cores. Ranges of a launch wait for each other, so the threads of two
    workers on the same cores made some tests forty times as slow.
    """
    compile_module = Module._compile

    def once(self: Any, device: Any, folder: str, *more: Any, **options: Any) -> bool:
        with FileLock(Path(tempfile.gettempdir(), f"{Path(folder).name}.lock")):
            return compile_module(self, device, folder, *more, **options)

    Module._compile = once  # pyright: ignore[reportAttributeAccessIssue]
    if (worker := os.environ.get("PYTEST_XDIST_WORKER")) and sys.platform == "linux":
        cores, workers = sorted(os.sched_getaffinity(0)), int(os.environ["PYTEST_XDIST_WORKER_COUNT"])
        if share := cores[int(worker.removeprefix("gw")) % len(cores) :: workers]:
            os.sched_setaffinity(0, share)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Say which tests a plain run leaves out."""
    if "not slow" in str(config.getoption("markexpr")):
        terminalreporter.write_line(
            "Left out: tests marked slow (killed processes, browsers, other solvers); run them with pytest -m slow"
        )


@pytest.fixture(scope="session")
def plain_report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of a result with a name that is markup, by a program that must load neither Warp nor the viewer.

    Each costs as much as all pictures of the spine; nor can a report wait for kernels that are compiled.
    """
    folder = write_small_result(tmp_path_factory.mktemp("plain"), name='<script>alert("x")</script> & Co')
    code = f"from warp_trunk.cli import main; main(['report', {str(folder)!r}])"
    code += "; import sys; sys.exit(bool({'warp', 'rerun'} & {*sys.modules}))"
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
    return folder / "report.html"


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs a command that must end in status 2 and one line that holds all the fragments; returns the line."""

    def run(arguments: Sequence[object], *fragments: str) -> str:
        assert main([str(word) for word in arguments]) == BAD_INPUT
        said = capsys.readouterr()
        assert said.out == ""
        assert "Traceback" not in said.err
        errors = [line for line in said.err.splitlines() if line.startswith("warp-trunk: ")]
        assert errors == said.err.splitlines()[-1:]
        assert [fragment for fragment in fragments if fragment not in errors[0]] == [], errors[0]
        return errors[0]

    return run


@pytest.fixture
def refused_row(
    refused: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[str, Sequence[object]], str]:
    """The row of an accepted text: the line in which a command is refused."""
    monkeypatch.delenv("UV_RUN_RECURSION_DEPTH", raising=False)  # by which commands to paste begin with `uv run`

    def made(name: str, arguments: Sequence[object]) -> str:
        with row(name):
            return f"{name}: {plain_line(refused(arguments), tmp_path)}"

    return made

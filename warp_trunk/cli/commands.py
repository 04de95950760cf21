"""From the words of a command line to a command, whose file is loaded only then, and to an exit status."""

import ast
import atexit
import errno
import gc
import importlib
import io
import os
import sys
import textwrap
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from warp_trunk import __version__
from warp_trunk.errors import InputError, closest_name

from .output import BAD_INPUT, FILE_ERROR, INTERRUPTED, OK

COMMANDS = {
    "demo": "simulate.Demo",
    "doctor": "doctor.Doctor",
    "close": "surfaces.Close",
    "triangulate": "films.Triangulate",
    "register": "films.Register",
    "fit-atlas": "films.FitAtlas",
    "fit-back": "back.FitBack",
    "import": "import_case.Import",
    "landmarks": "surfaces.FindLandmarks",
    "plan": "plan.PlanCommand",
    "make-case": "surfaces.MakeCase",
    "cut": "surfaces.Cut",
    "simulate": "simulate.Simulate",
    "view": "result.View",
    "report": "result.Report",
    "measure": "measure.Measure",
    "export": "result.Export",
    "cohort": "cohort.Cohort",
    "calibrate": "cohort.Calibrate",
}
"""The file and class of each command, in the order in which they are used: first steps, from a patient to a case,
from there to a result, and many of them."""


def load(words: list[str]) -> Any:
    """The class of the command that the first word names.

    Raises:
        InputError: there is no word, or no such command.
    """
    names = ", ".join(COMMANDS)
    if not words:
        raise InputError(f"a command is needed: one of {names}; start with warp-trunk demo")
    name = words[0]
    if name not in COMMANDS:
        raise InputError(f"'{name}': there is no such command{closest_name(name, COMMANDS)}; known are {names}")
    module, kind = COMMANDS[name].split(".")
    return getattr(importlib.import_module(f".{module}", __package__), kind)


def overview() -> str:
    """The text of `warp-trunk --help`: each command with the first sentence of its documentation."""
    width = max(map(len, COMMANDS)) + 4
    lines = ["usage: warp-trunk COMMAND ...", ""]
    lines += ["Predict how the trunk of a scoliosis patient looks after spine surgery.", ""]
    for name in COMMANDS:
        lines += textwrap.wrap(
            _sentence(name), 100, initial_indent=f"  {name:<{width}}", subsequent_indent=" " * (width + 2)
        )
    lines += ["", "warp-trunk COMMAND --help lists the options of each; warp-trunk --version prints the version."]
    return "\n".join(lines)


def _sentence(name: str) -> str:
    """The first sentence of a command's documentation, read from its file without loading it."""
    module, kind = COMMANDS[name].split(".")
    source = Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8")
    node = next(n for n in ast.parse(source).body if isinstance(n, ast.ClassDef) and n.name == kind)
    return " ".join((ast.get_docstring(node) or "").split("\n\n")[0].split())


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command; returns its exit status, 0 only for a simulation that converged."""
    if arguments is None:
        arguments = sys.argv[1:]
        _open_streams()
        atexit.register(gc.freeze)  # Python would look for garbage in all that is left, for a third of a second
        # BLAS would keep a thread on every core, which waits there for its next product and holds up our own
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if arguments and arguments[0] in ("-h", "--help"):
        print(overview())
        return OK
    if arguments and arguments[0] in ("-V", "--version"):
        print(f"warp-trunk {__version__}")
        return OK
    warnings.formatwarning = lambda message, *_, **__: f"warp-trunk: warning: {message}\n"
    try:
        return _loaded(list(arguments)).run()
    except InputError as error:
        print(f"warp-trunk: {error}", file=sys.stderr)
        return BAD_INPUT
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        cure = "; free some space there, or name another place" if full else ""
        where = f"{error.filename}: {error.strerror}" if error.filename and error.strerror else error
        print(f"warp-trunk: {where}{cure}", file=sys.stderr)
        return FILE_ERROR
    except KeyboardInterrupt:
        print("warp-trunk: interrupted", file=sys.stderr)
        return INTERRUPTED


class _Pipe(io.FileIO):
    """Where words go; a command goes on and writes its files if its reader leaves before the end."""

    def write(self, words: Any, /) -> int:
        """The number of bytes that were taken."""
        try:
            return super().write(words) or 0
        except BrokenPipeError:
            return len(words)


def _open_streams() -> None:
    """Has both streams take every word: a file gets UTF-8 on every system, a screen what it can show.

    Streams that are closed, or missing as under pythonw, lead nowhere, so that no file of the program takes
    their numbers.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the least free number
    for name, number in (("stdout", 1), ("stderr", 2)):
        stream = getattr(sys, name)
        if stream is not None and stream.isatty():
            stream.reconfigure(errors="replace")
        elif stream is None or isinstance(stream, io.TextIOWrapper):
            buffer = io.BufferedWriter(_Pipe(number, "w", closefd=False))
            text = io.TextIOWrapper(buffer, "utf-8", errors="replace", line_buffering=name == "stderr")
            setattr(sys, name, text)


def _loaded(arguments: list[str]) -> Any:
    """The command that is asked for."""
    gc.disable()  # what is loaded is no garbage; to look for some again and again takes a sixth of the time
    try:
        kind = load(arguments)
        from .arguments import parse_command

        return parse_command(kind, arguments)
    finally:
        gc.freeze()
        gc.enable()

"""From the words of a command line to a command, and from its end to an exit status."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Sequence
from typing import Annotated

import warp as wp
from tyro.conf import subcommand

from warp_trunk.errors import InputError

from .arguments import parse
from .close import Close
from .demo import Demo
from .doctor import Doctor
from .exit_status import BAD_INPUT, INTERRUPTED, NOT_CONVERGED
from .export import Export
from .fit_atlas import FitAtlas
from .landmarks import FindLandmarks
from .make_case import MakeCase
from .measure import Measure
from .plan import Plan
from .register import Register
from .report import Report
from .simulate import Simulate
from .triangulate import Triangulate
from .view import View

Command = (
    Annotated[Demo, subcommand("demo")]
    | Annotated[Doctor, subcommand("doctor")]
    | Annotated[Close, subcommand("close")]
    | Annotated[Triangulate, subcommand("triangulate")]
    | Annotated[Register, subcommand("register")]
    | Annotated[FitAtlas, subcommand("fit-atlas")]
    | Annotated[FindLandmarks, subcommand("landmarks")]
    | Annotated[Plan, subcommand("plan")]
    | Annotated[MakeCase, subcommand("make-case")]
    | Annotated[Simulate, subcommand("simulate")]
    | Annotated[View, subcommand("view")]
    | Annotated[Report, subcommand("report")]
    | Annotated[Measure, subcommand("measure")]
    | Annotated[Export, subcommand("export")]
)
"""In the order in which they are used: to begin with, from a patient to a case, and from a case to a result."""


def start_warp() -> None:
    """Starts Warp without the line that its native part prints on every machine without CUDA.

    It writes past Python's streams, so the file descriptor is turned aside; anything else it says is passed on.
    """
    sys.stderr.flush()
    kept = os.dup(2)
    with tempfile.TemporaryFile() as aside:
        os.dup2(aside.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(kept, 2)
            os.close(kept)
        aside.seek(0)
        for line in aside.read().decode(errors="replace").splitlines():
            if "Could not find or load the NVIDIA CUDA driver" not in line:
                print(line, file=sys.stderr)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command; returns its exit status, 0 only for a simulation that converged."""
    wp.config.log_level = wp.LOG_WARNING  # not a line for each kernel
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    try:
        command = parse(Command, arguments)
        start_warp()
        return command.run(arguments[1:])
    except InputError as error:
        print(f"warp-trunk: {error}", file=sys.stderr)
        return BAD_INPUT
    except OSError as error:
        print(f"warp-trunk: {error}", file=sys.stderr)
        return NOT_CONVERGED
    except KeyboardInterrupt:
        print("warp-trunk: interrupted; --resume goes on from a simulation's last increment", file=sys.stderr)
        return INTERRUPTED

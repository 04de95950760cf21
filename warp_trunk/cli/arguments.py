"""Flags of the command line, made of the fields of a command's dataclass."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Sequence
from typing import Any

import tyro
from tyro.conf import OmitArgPrefixes

from warp_trunk.errors import InputError


def parse(command: Any, arguments: Sequence[str], default: Any = None) -> Any:
    """The command that the arguments ask for.

    Raises:
        InputError: arguments that do not fit; SystemExit where they ask for help.
    """
    said = io.StringIO()
    options = {} if default is None else {"default": default}
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(
                OmitArgPrefixes[command],
                prog="warp-trunk",
                description="Predict how the trunk of a scoliosis patient looks after spine surgery.",
                args=list(arguments),
                **options,
            )
    except SystemExit as end:
        if not end.code:
            raise
        raise InputError(one_line(said.getvalue())) from None


def one_line(box: str) -> str:
    """The message in the box that tyro draws around it, in one line, without its title and the hint for help."""
    plain_box = re.sub(r"\x1b\[[0-9;]*m", "", box)  # colours, on a terminal
    rows = [row.strip(" │") for row in plain_box.splitlines()]
    rows = [row for row in rows if row and row[0] not in "╭╰"]
    if len(rows) > 1 and _is_rule(rows[1]):
        rows = rows[2:]  # where the terminal has no box characters, the title stands over a rule
    end = next((i for i, row in enumerate(rows) if _is_rule(row)), len(rows))
    hint = [f"({row})" for row in rows[end:] if row.startswith("Available subcommands")]
    text = " ".join(" ".join([*rows[:end], *hint]).split())
    return re.sub(r"^Error parsing __tyro-dummy-inner__[\w.-]*: ", "", text) or "the arguments do not fit"


def _is_rule(row: str) -> bool:
    return set(row) <= {"─", "-"}

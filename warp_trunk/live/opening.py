"""From a case folder to the page, until it is to end."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from warp_trunk.bone_motion.plan import plan_surgery
from warp_trunk.errors import InputError
from warp_trunk.run.patient import patient_of, with_mesh_given

if TYPE_CHECKING:
    from warp_trunk.bone_motion.plan import Plan
    from warp_trunk.case import Case
    from warp_trunk.run.options import RunOptions
    from warp_trunk.run.progress import Progress

PORT = 8137
"""Where the page is when nothing else is asked for."""
PACKAGES = ("threadpoolctl", "viser")
"""The packages of the extra `live`."""


def check_packages() -> None:
    """InputError where the extra is not installed."""
    if missing := [name for name in PACKAGES if find_spec(name) is None]:
        raise InputError(
            f"--live: needs packages that are not installed ({', '.join(missing)}); "
            "pip install 'warp-trunk[live]' (in a clone: uv sync --extra live)"
        )


def check_port(port: int) -> None:
    """InputError for a port that no program of a user may have."""
    if not 1024 <= port <= 65535:
        raise InputError(f"--port: must be from 1024 to 65535, not {port}; give {PORT}")


def plan_live(
    case: Case,
    folder: Path,
    options: RunOptions,
    progress: Progress,
    *,
    plan: Plan | None = None,
    port: int = PORT,
) -> str | None:
    """Opens the planning page and waits until it is to end: by its button, Ctrl-C, or a signal.

    Args:
        case: the patient; what is planned in it is not read.
        folder: where kept plans go.
        options: how the tissue is simulated.
        progress: receives the stages.
        plan: where the sliders stand first; at rest when left out.
        port: where the page is, on this machine alone.

    Returns:
        What went wrong, in words, where that ended it.

    Raises:
        InputError: the extra is not installed, the port is taken, the case cannot be planned, or what `patient_of`
            raises.
    """
    check_packages()
    from .loopback import check_free
    from .motion_wish import MotionPlanner, with_handles
    from .page import Page
    from .wish import first_wish, spine_before

    check_port(port)
    check_free(port)
    if case.has_spine:  # what is impossible is refused before any work
        plan_surgery(case, first_wish(spine_before(case.landmarks_before), plan).plan(plan))
    else:
        if options.bones == "spline":
            raise InputError("--bones spline: needs a spine, and bones move by motions alone; leave it out")
        case = with_handles(case)
        MotionPlanner(case).plan(case.motions)
    case, given = with_mesh_given(case, options, progress)
    patient = patient_of(case, options, given, progress)
    with progress.stage("compile", "preparing the relaxation"):
        _ = patient.relaxer
    with _ending_signals() as asked, Page(patient, folder, port, plan) as page:
        progress.message(f"Plan at {page.server.address} on this machine; Ctrl-C or its button ends it")
        while not (asked.is_set() or page.stopped.wait(0.2)):
            pass
    for name in page.kept.new_names:
        progress.message(f"Kept: {folder / name}")
    return page.failure


@contextmanager
def _ending_signals() -> Iterator[threading.Event]:
    """An event that Ctrl-C or a request to end sets, while the block runs; what is being written is finished."""
    asked, before = threading.Event(), {}
    for number in (signal.SIGINT, signal.SIGTERM):
        before[number] = signal.signal(number, lambda *_: asked.set())
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

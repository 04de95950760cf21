"""From a case folder to the page, until it is to end."""

from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

from warp_trunk.bone_motion.plan import Plan
from warp_trunk.case import Case
from warp_trunk.errors import InputError
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.patient import patient_of
from warp_trunk.run.progress import Progress
from warp_trunk.system import interrupted_when_ended

PACKAGES = ("threadpoolctl", "viser")
"""The packages of the extra `live`."""


def plan_live(
    case: Case,
    folder: Path,
    options: RunOptions,
    execution: Execution,
    progress: Progress,
    *,
    port: int,
    plan: Plan | None = None,
) -> str | None:
    """Opens the planning page and waits until it is to end: by its button, Ctrl-C, or a signal.

    Args:
        case: the patient; what is planned in it is not read.
        folder: where kept plans go.
        options: what is simulated.
        execution: how it is computed.
        progress: receives the stages.
        port: where the page is, on this machine alone.
        plan: where the sliders stand first; at rest when left out.

    Returns:
        What went wrong, in words, where that ended it.

    Raises:
        InputError: the extra is not installed, the port is taken, the case cannot be planned, or what `patient_of`
            raises.
    """
    if missing := [name for name in PACKAGES if find_spec(name) is None]:
        raise InputError(
            f"--live: needs packages that are not installed ({', '.join(missing)}); "
            "pip install 'warp-trunk[live]' (in a clone: uv sync --extra live)"
        )
    from .loopback import check_port
    from .planning_page import Page
    from .sliders import MotionSliders, SpineSliders, first_state, with_handles

    check_port(port)
    if not case.has_spine:
        if options.bones == "spline":
            raise InputError("--bones spline: needs a spine, and bones move by motions alone; leave it out")
        case = with_handles(case)
    sliders = SpineSliders(case, plan) if case.has_spine else MotionSliders(case)
    sliders.surgery(first_state(sliders))  # what is impossible is refused before any work
    patient = patient_of(case, options, execution=execution, progress=progress)
    with progress.stage("compile", "preparing the relaxation"):
        _ = patient.relaxer
    with interrupted_when_ended(), Page(patient, sliders, folder, port) as page, suppress(KeyboardInterrupt):
        progress.message(f"Plan at {page.server.address} on this machine; Ctrl-C or its button ends it")
        while not page.stopped.wait(0.2):  # a signal that another thread got is handled between two waits
            pass
    for name in page.saved.views:
        if name not in page.saved.earlier:
            progress.message(f"Kept: {folder / name}")
    return page.failure

"""warp-trunk plan"""

import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import tyro
from tyro.conf import Positional, UseAppendAction

from warp_trunk.bone_motion.articulation import unknown_bones
from warp_trunk.bone_motion.plan import Plan, lenke_of, plan_surgery, read_plan
from warp_trunk.bone_motion.plan.plan_file import (
    check_planned_folder,
    curve_of_text,
    plan_text,
    write_planned_case,
    written_plan,
)
from warp_trunk.bone_motion.plan.surgery import back_text, surgery_text
from warp_trunk.case import read_case, read_checked_case
from warp_trunk.case.anatomy import PELVIC_RING
from warp_trunk.case.folders import refuse_case
from warp_trunk.case.landmark_checks import check_motion
from warp_trunk.errors import InputError
from warp_trunk.run.best_plan import best_plan, best_plan_text
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.progress import Progress
from warp_trunk.run.simulate import simulate
from warp_trunk.spine import cobb_angles

from .output import NOT_CONVERGED, OK, next_command
from .simulate import COMMON, crossings_written, report_ending


@dataclass(frozen=True, kw_only=True)
class PlanCommand:
    """Plan a surgery: place every vertebra for an intended correction."""

    common: ClassVar[frozenset[str]] = COMMON
    case: Positional[Path]
    """Case folder; it needs no landmarks_after."""
    out: Path | None = None
    """Case folder to write, with landmarks_after.csv, plan.toml and plan.json. With --live the folder in which
    every plan that is kept has a case folder; beside the case, its name and _plans, when left out."""
    plan: Path | None = None
    """plan.toml with the intention; an option given here takes the place of what it says."""
    uiv: str | None = None
    """Upper instrumented vertebra, such as T4."""
    liv: str | None = None
    """Lower instrumented vertebra, such as L1."""
    curve: UseAppendAction[tuple[str, ...]] = ()
    """A curve as its apex and what is asked of it: T8,correction=0.65,derotation=0.4 (or cobb_after and
    rotation_after in degrees); once for each curve."""
    kyphosis_T5_T12: float | None = None  # noqa: N815
    """Thoracic kyphosis after [degrees]; kept when left out."""
    lordosis_L1_L5: float | None = None  # noqa: N815
    """Lumbar lordosis after [degrees]; kept when left out."""
    unfused: Literal["follow", "fixed"] | None = None
    """Segments outside the fusion follow (the default) or keep their rotation."""
    spontaneous: float | None = None
    """Share of an unfused curve that corrects by itself, 0 to 1; from films of side bending, without them 0.75 of
    the share of the fused curves."""
    balance: Literal["posture", "keep", "centre"] | None = None
    """Where T1 stands in the coronal plane: as patients stand after surgery (the default), as before, or over the
    sacrum."""
    sva_after: float | None = None
    """How far T1 stands in front of the sacrum after [mm]; kept when left out."""
    aim: Literal["hump", "bsr"] | None = None
    """Change the plan within --within so that the largest hump, or the largest back surface rotation, is smallest,
    write that plan, and report the improvement; takes up to nine relaxations."""
    within: UseAppendAction[tuple[str, ...]] = ()
    """Bounds within which --aim may change a curve of the plan:
    T8,correction=0.5..0.8,derotation=0.2..0.6; once for each curve."""
    predict: bool = False
    """Simulate the planned case too, into results/ and the name of the planned folder, and print what becomes of
    the back."""
    port: int = 8137
    """With --live: where the page is, on this machine alone."""
    live: bool = False
    """Open the planning page in the browser, which predicts while you move sliders."""
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = field(default_factory=RunOptions)
    """The physics and the discretisation."""
    execution: Annotated[Execution, tyro.conf.arg(name="")] = field(default_factory=Execution)
    """How it is computed and kept."""

    def run(self) -> int:
        """Writes the planned case and prints what the plan asks for, or opens the planning page."""
        if self.live:
            return self._open_page()
        if self.out is None:
            raise InputError("plan: --out is missing; give the case folder to write, or --live to plan on a page")
        if (self.aim is None) != (not self.within):
            example = "--aim hump --within T8,correction=0.5..0.8"
            raise InputError(f"plan: --aim and --within belong together; give both, as {example}")
        check_planned_folder(self.out, self.case)
        with Progress() as progress:
            with progress.stage("load", f"reading {self.case}"):
                case, warnings = read_checked_case(self.case)
            for warning in (*warnings, *unknown_bones(case.bones)):
                progress.message(f"warning: {warning}")
            if not case.has_spine:
                cure = "write the motions of its bones in motions.toml and simulate it, or move them with --live"
                raise InputError(f"plan: {self.case} has no landmarks of a spine; {cure}")
            if case.bones.keys().isdisjoint(PELVIC_RING):
                rule = f"has no bone of the pelvis ({', '.join(PELVIC_RING)}), and nothing holds the trunk there"
                raise InputError(f"plan: {self.case} {rule} (skin moves 21 for 13 mm); add one to its bones")
            intention = self._intention(case.landmarks_before)
            best = None
            if self.aim is not None:
                best = best_plan(
                    case, intention, self.within, self.aim, self.options, self.execution, progress=progress
                )
            surgery = plan_surgery(case, intention if best is None else best.plan)
            if written_plan(self.out) not in (None, plan_text(surgery.plan)):
                progress.message(
                    f"warning: {self.out}: its older plan is replaced; to keep both, give another --out"
                )
            with progress.stage("write", f"writing {self.out}"):
                planned = write_planned_case(self.out, case, surgery)
            kind = lenke_of(case)
            print(*([f"Curve type: Lenke {kind}"] if kind else []), surgery_text(surgery), sep="\n")
            for warning in check_motion(case.landmarks_before, planned.planned_landmarks, "the plan"):
                progress.message(f"warning: {warning}")
            if best is not None:
                print(f"\n{best_plan_text(best)}")
            print(f"\nPlanned case written to {self.out}")
            if not self.predict:
                print(f"Simulate it: {next_command('simulate', self.out)}")
                return OK
            out = Path("results") / self.out.resolve().name
            with crossings_written(out):
                result = simulate(planned, None, self.options, self.execution, folder=out, progress=progress)
        print(f"\n{back_text(result.measures_before, result.measures)}\n")
        return report_ending(result)

    def _open_page(self) -> int:
        from warp_trunk.live.opening import plan_live

        if self.predict or self.aim is not None or self.within:
            other = "--predict" if self.predict else "--aim and --within"
            raise InputError(f"--live: predicts while you plan; leave {other} out")
        folder = self.out or self.case.resolve().with_name(f"{self.case.resolve().name}_plans")
        refuse_case(folder)
        with Progress() as progress:
            with progress.stage("load", f"reading {self.case}"):
                case = read_case(self.case)
            asked = self.plan or self.uiv or self.liv or self.curve
            if not case.has_spine and (asked or not case.motions):
                cure = "name the bones that move in motions.toml, and give no option of a plan"
                raise InputError(f"--live: {self.case} has no landmarks of a spine; {cure}")
            plan = self._intention(case.landmarks_before) if asked else None
            with crossings_written(folder):
                failure = plan_live(
                    case, folder, self.options, self.execution, progress, plan=plan, port=self.port
                )
        if failure is not None:
            print(f"warp-trunk: the planning page ended by a fault of the program, {failure}", file=sys.stderr)
            return NOT_CONVERGED
        return OK

    def _intention(self, before: Any) -> Plan:
        """The plan of the file with the options of the command in place of what it says."""
        stated: dict[str, Any] = {
            name: value
            for name in ("uiv", "liv", "kyphosis_T5_T12", "lordosis_L1_L5", "unfused", "spontaneous", "balance",
                         "sva_after")
            if (value := getattr(self, name)) is not None
        }  # fmt: skip
        if self.curve:
            stated["curves"] = tuple(curve_of_text(text) for text in self.curve)
        if self.plan is not None:
            return replace(read_plan(self.plan), **stated)
        if "uiv" not in stated or "liv" not in stated:
            curves = ", ".join(
                f"{c.angle:.0f} degrees {c.upper} to {c.lower} with apex {c.apex}" for c in cobb_angles(before)
            )
            raise InputError(
                f"plan: give --plan plan.toml, or --uiv, --liv and --curve; the curves are {curves or 'none'}"
            )
        return Plan(**stated)

"""The sliders of a patient, where they stand first, and the surgery that they ask for: a plan or motions."""

import math
import re
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import viser

from warp_trunk.bone_motion.plan import CurvePlan, Plan, PlannedSurgery, Planner
from warp_trunk.bone_motion.plan.targets import curve_around
from warp_trunk.bone_motion.skeleton import Skeleton
from warp_trunk.case import Case, write_case
from warp_trunk.case.anatomy import rank
from warp_trunk.case.landmarks import NO_LANDMARKS, Landmarks
from warp_trunk.case.motion_checks import check_motions, check_passing
from warp_trunk.case.motions import Motion, Turn, rigid_motions
from warp_trunk.errors import InputError
from warp_trunk.run.patient import motions_of
from warp_trunk.spine import cobb_angles
from warp_trunk.spine.apical import axial_rotation
from warp_trunk.spine.cobb import kyphosis
from warp_trunk.spine.spine import asis_axis, spine_of

from .loopback import BUTTONS


class Setting(NamedTuple):
    """The quantity that a control sets."""

    quantity: str
    """uiv, liv, kyphosis, correction or derotation; of a bone a component of its motion, or what it follows."""
    of: str = ""
    """The apex of the curve, or the bone."""


SliderState = Mapping[Setting, Any]
"""Where the controls of a patient stand."""
UIV, LIV, KYPHOSIS = Setting("uiv"), Setting("liv"), Setting("kyphosis")
SHARES = ("correction", "derotation")
KYPHOSIS_RANGE = (10, 50, 1)
"""Range of the kyphosis T5-T12 after surgery [degrees]: 20 to 40 is normal. The patient's own, and that of the
first plan, are always in it."""
REACH = 20
"""A slider of a motion reaches at least this far to either side [mm or degrees]."""
COMPONENTS = ("Left mm", "Back mm", "Up mm", "Pitch °", "Roll °", "Yaw °")
"""Labels of the components of a motion: translation along and rotation vector about x, y and z in LPS."""
PAUSE = 2.0
"""A slider that rests for so long [s] has been released, as has one when another moves: undo returns to there."""
MOST_UNDO = 100
"""Number of states of the sliders that can be undone."""
_MISSED = re.compile(
    r"plan: curve (?P<apex>\w+): (?P<what>Cobb angle|rotation) after (?P<goal>\S+) degrees cannot be met with "
    r"what else is asked and kept; the nearest is (?P<nearest>[^;]+); .*"
)
"""The refusal of a target of a curve."""
_WORDS = {
    "plan: ": "",
    "kyphosis_T5_T12": "kyphosis T5-T12 of",
    "lordosis_L1_L5": "lordosis L1-L5 of",
    "coronal balance": "balance to the side of",
    "sva_after": "balance to the front of",
    "'uiv'": "the upper vertebra",
    "'liv'": "the lower vertebra",
}
"""Names of files and their words on the page."""
_STILL = Motion(transform=((1.0, 0, 0, 0), (0, 1.0, 0, 0), (0, 0, 1.0, 0), (0, 0, 0, 1.0)))


@dataclass(frozen=True)
class Control:
    """A slider, or a list where it has choices."""

    folder: str
    """The heading above it."""
    label: str
    """Its name on the page."""
    first: Any
    """Its first value."""
    span: tuple[float, float, float] = (0, 100, 1)
    """Its least and its largest value, and its step."""
    choices: tuple[str, ...] = ()
    """The values of a list."""
    hint: str | None = None
    """Its meaning, for the page."""


_INWARD = 0.1
"""Handles lie this fraction of the way from the surface of a bone to its centre: no two bones share one."""


@dataclass(frozen=True, eq=False)
class MotionPlan:
    """Where motions take the bones of a case."""

    motions: Mapping[str, Motion]
    """The motions of the plan, by bone."""
    landmarks_after: Landmarks
    """The handles of the bones after surgery (`with_handles`)."""

    def planned_case(self, case: Case) -> Case:
        """The case with these motions; an actual skin belongs to another surgery and is left out."""
        return replace(case, motions=dict(self.motions), actual_skin=None)

    def write(self, folder: Path, case: Case, name: str) -> None:
        """Write the planned case, without handles."""
        planned = self.planned_case(replace(case, landmarks_before=NO_LANDMARKS))
        write_case(folder, replace(planned, name=f"{case.name}, motions {name}"))


def plan_motions(case: Case, motions: Mapping[str, Motion], skeleton: Skeleton | None = None) -> MotionPlan:
    """Where motions take every bone of a case with handles; of a skeleton that was made before, if there is one.

    Raises:
        InputError: the bones cannot move like this (`check_motions`, `check_passing`).
    """
    planned = replace(case, motions=dict(motions))
    check_motions(planned, "motions")
    check_passing(planned, motions_of(planned, skeleton), "motions")
    return MotionPlan(motions, planned.planned_landmarks)


def with_handles(case: Case) -> Case:
    """The case with handles in place of landmarks: up to six points of each bone that move with it.

    The spline of the handles gives the image of a plan before the tissue is relaxed. A bone that is carried by
    others, such as a costal cartilage, has no handles, so that the spline carries it as well.
    """
    motions = motions_of(case)
    names: list[str] = []
    points = []
    for bone, surface in case.bones.items():
        if bone not in case.given_motions and motions[bone].moves:
            continue
        vertices = surface.vertices
        own = vertices[np.unique([*vertices.argmin(axis=0), *vertices.argmax(axis=0)])]
        points.append(own + _INWARD * (vertices.mean(axis=0) - own))
        names += [f"{bone}_handle_{number}" for number in range(len(own))]
    return replace(case, landmarks_before=Landmarks(tuple(names), np.vstack(points)))


class SpineSliders:
    """Controls for every curve, the kyphosis and the ends of the fusion."""

    def __init__(self, case: Case, base: Plan | None = None) -> None:
        """Controls that stand at a plan, or at rest with the largest curve fused.

        A plan's `cobb_after` and `rotation_after` become the shares that they are, to a whole per cent.

        Args:
            case: the patient.
            base: the first plan, which also holds what no slider says.
        """
        before = case.landmarks_before
        spine, self._levels = spine_of(before), before.vertebrae()
        self._planner, self._base = Planner(case), base
        self._curves = {curve.apex: curve for curve in cobb_angles(before)}
        self._rotation = axial_rotation(spine, asis_axis(before))
        largest = max(self._curves.values(), key=lambda curve: curve.angle, default=None)
        uiv, liv = (self._levels[0], self._levels[-1]) if largest is None else (largest.upper, largest.lower)
        shares: dict[Setting, int] = {}
        if base is not None:
            uiv, liv, shares = base.uiv, base.liv, self._shares(base)
        self.controls: dict[Setting, Control] = {
            UIV: Control("Fusion", "Upper vertebra", uiv, choices=self._levels),
            LIV: Control("Fusion", "Lower vertebra", liv, choices=self._levels),
        }
        """The controls by what they set."""
        for apex, curve in self._curves.items():
            folder = f"Curve {curve.upper}-{curve.lower}, {curve.convex}, {curve.angle:.0f}°"
            for name, angle in (("correction", "Cobb angle"), ("derotation", f"axial rotation of {apex}")):
                key, hint = Setting(name, apex), f"Share of the {angle} that surgery takes away"
                label = f"{name.capitalize()} %"
                self.controls[key] = Control(folder, label, shares.get(key, 0), hint=hint)
        now, asked = kyphosis(spine)["T5-T12"], None if base is None else base.kyphosis_T5_T12
        if now is not None:
            self._still = round(now)
            hint = f"Before surgery {now:.0f}°, which is kept where the slider stands there"
            first = self._still if asked is None else round(asked)
            least, most, step = KYPHOSIS_RANGE
            span = (min(least, self._still, first), max(most, self._still, first), step)
            self.controls[KYPHOSIS] = Control("Kyphosis", "T5-T12 °", first, span, hint=hint)

    def plan(self, state: SliderState) -> Plan:
        """The plan of the controls; what they do not say is that of the first plan.

        A curve in the fusion at 0 % keeps its angle, and an apex at 0 % is not turned on purpose. With all sliders
        at rest nothing is asked, and nothing moves.

        Raises:
            InputError: levels in the wrong order, or a number that no slider has.
        """
        ends = {"uiv": state[UIV], "liv": state[LIV]}
        if rank(ends["uiv"]) >= rank(ends["liv"]):  # in the words of the page
            raise InputError(
                f"the upper vertebra must lie above the lower one, but {ends['uiv']} is not above {ends['liv']}; "
                "choose another one"
            )
        plan = replace(self._base or Plan(**ends), **ends, curves=(), kyphosis_T5_T12=None)
        curves = []
        for apex in self._curves:
            if rank(plan.uiv) <= rank(apex) <= rank(plan.liv):
                correction, derotation = (state[Setting(name, apex)] / 100.0 for name in SHARES)
                curves.append(CurvePlan(apex, correction=correction, derotation=derotation or None))
        unchanged = KYPHOSIS not in state or state[KYPHOSIS] == self._still
        if unchanged and not any(curve.correction or curve.derotation for curve in curves):
            return plan
        return replace(plan, curves=curves, kyphosis_T5_T12=None if unchanged else float(state[KYPHOSIS]))

    def surgery(self, state: SliderState) -> PlannedSurgery:
        """The surgery that the controls ask for; InputError if the spine cannot meet it."""
        return self.of_plan(self.plan(state))

    def of_plan(self, plan: Plan) -> PlannedSurgery:
        """The surgery that a plan asks for; InputError, in the words of the page, if the spine cannot meet it."""
        try:
            return self._planner.plan(plan)
        except InputError as error:
            raise InputError(self._in_words(str(error))) from None

    def _in_words(self, refusal: str) -> str:
        """A refusal of a plan with the names and shares of the sliders in place of those of files."""
        if missed := _MISSED.fullmatch(refusal):
            curve = curve_around(missed["apex"], self._curves.values(), self._levels)
            of_cobb = missed["what"] == "Cobb angle"
            whole = None if curve is None else curve.angle if of_cobb else abs(self._rotation[curve.apex] or 0.0)
            if curve is not None and whole:
                asked, nearest = (_percent(None, float(missed[name]), whole) for name in ("goal", "nearest"))
                label = "Correction" if of_cobb else "Derotation"
                return (
                    f"{label} {asked} % of the curve {curve.upper}-{curve.lower} cannot be met with what else is "
                    f"asked and kept; the nearest is {nearest} %; ask for that, or fuse other levels"
                )
        for name, words in _WORDS.items():
            refusal = refusal.replace(name, words)
        return refusal

    def without_effect(self, state: SliderState) -> set[Setting]:
        """The controls of curves outside the fusion, which follow by themselves."""
        uiv, liv = rank(state[UIV]), rank(state[LIV])
        outside = [apex for apex in self._curves if not uiv <= rank(apex) <= liv]
        return {Setting(name, apex) for apex in outside for name in SHARES}

    def _shares(self, plan: Plan) -> dict[Setting, int]:
        """The values of the sliders of each curve that a plan names by any of its levels."""
        shares: dict[Setting, int] = {}
        for asked in plan.curves:
            curve = curve_around(asked.apex, self._curves.values(), self._levels)
            if curve is not None:
                turned = abs(self._rotation[curve.apex] or 0.0)
                values = (
                    _percent(asked.correction, asked.cobb_after, curve.angle),
                    _percent(asked.derotation, asked.rotation_after, turned),
                )
                shares |= {Setting(name, curve.apex): value for name, value in zip(SHARES, values, strict=True)}
        return shares


def _percent(share: float | None, after: float | None, before: float) -> int:
    if share is None:
        share = 0.0 if after is None or before == 0.0 else 1.0 - after / before
    return round(100.0 * min(max(share, 0.0), 1.0))


class MotionSliders:
    """A slider for each component of the motion of each bone of motions.toml."""

    def __init__(self, case: Case) -> None:
        """Controls that stand at the motions of a case with handles (`with_handles`).

        A transform becomes a rotation about the centre of its bone, and a translation.
        """
        self._case, moved = case, rigid_motions(case.motions)
        self._skeleton = Skeleton(case.bones, case.landmarks_before)
        self._points: dict[str, tuple[float, float, float]] = {}
        self.controls: dict[Setting, Control] = {}
        """The controls by what they set."""
        for bone, motion in case.motions.items():
            for other, share in (motion.follows or {}).items():
                first = round(100.0 * share, 1)
                self.controls[Setting(other, bone)] = Control(bone, f"Follows {other} %", first, (0, 100, 0.1))
            if motion.follows is None:
                turn, own = motion.rotation, moved[bone]
                point = case.bones[bone].vertices.mean(axis=0) if turn is None else np.array(turn.point)
                x, y, z = np.round(point, 9).tolist()
                self._points[bone] = (x, y, z)
                values = [*(own.apply(point) - point), *np.degrees(own.log()[:3])]
                for label, value in zip(COMPONENTS, np.round(values, 9).tolist(), strict=True):
                    most = max(REACH, math.ceil(2.0 * abs(value)))
                    self.controls[Setting(label, bone)] = Control(bone, label, value, (-most, most, 0.1))

    def motions(self, state: SliderState) -> dict[str, Motion]:
        """The motions that the controls describe, by bone."""
        return {bone: self._motion(bone, motion, state) for bone, motion in self._case.motions.items()}

    def _motion(self, bone: str, asked: Motion, state: SliderState) -> Motion:
        if asked.follows is not None:
            shares = {other: state[Setting(other, bone)] / 100.0 for other in asked.follows}
            shares = {other: share for other, share in shares.items() if share > 0.0}
            return Motion(follows=shares) if shares else _STILL
        x, y, z, *rotation = (state[Setting(label, bone)] for label in COMPONENTS)
        degrees = float(np.linalg.norm(rotation))
        if not (degrees or x or y or z):
            return _STILL
        axis = (rotation[0], rotation[1], rotation[2])
        turn = Turn(degrees=degrees, axis=axis, point=self._points[bone]) if degrees else None
        return Motion(translation=(x, y, z), rotation=turn, large=asked.large)

    def surgery(self, state: SliderState) -> MotionPlan:
        """Where the controls take the bones; InputError if they cannot move like this."""
        return plan_motions(self._case, self.motions(state), self._skeleton)

    def without_effect(self, _: SliderState) -> set[Setting]:
        """None of the controls."""
        return set()


Sliders = SpineSliders | MotionSliders


def first_state(sliders: Sliders) -> SliderState:
    """Where the controls stand first."""
    return {name: control.first for name, control in sliders.controls.items()}


class Controls:
    """Sliders and lists with undo. All browsers share them."""

    def __init__(self, gui: viser.GuiApi, sliders: Sliders, changed: Callable[[SliderState], None]) -> None:
        """Adds the controls to the page.

        Args:
            gui: the page.
            sliders: what can be set.
            changed: called with each state, from any thread.
        """
        self._sliders, self._changed = sliders, changed
        self._lock, self._setting = threading.RLock(), False
        self._state, self._past, self._last = first_state(sliders), list[SliderState](), 0.0
        self._dragged = set[Setting]()
        self._handles: dict[Setting, Any] = {}
        for folder, group in groupby(sliders.controls.items(), key=lambda item: item[1].folder):
            with gui.add_folder(folder):
                for name, control in group:
                    if control.choices:
                        handle = gui.add_dropdown(control.label, control.choices, initial_value=control.first)
                    else:
                        handle = gui.add_slider(control.label, *control.span, control.first, hint=control.hint)
                    handle.on_update(self._moved)
                    self._handles[name] = handle
        self.names = [f"{control.folder}: {control.label}" for control in sliders.controls.values()]
        """The name of each control for a screen reader."""
        self._undo = gui.add_button("Undo", disabled=True, color=BUTTONS)
        self._undo.on_click(lambda _: self.undo())
        self._enable()

    def undo(self) -> None:
        """Return to the previous resting position of the sliders."""
        with self._lock:
            if self._past:
                self._state, self._last, self._setting = self._past.pop(), 0.0, True
                try:
                    for name, value in self._state.items():
                        self._handles[name].value = value
                finally:
                    self._setting = False
                self._enable()
                self._changed(self._state)

    def _moved(self, _: object) -> None:
        with self._lock:
            state = {name: handle.value for name, handle in self._handles.items()}
            if self._setting or state == self._state:
                return
            now = time.monotonic()
            changed = {name for name in state if state[name] != self._state[name]}
            if changed != self._dragged or now - self._last > PAUSE:
                self._past = [*self._past[1 - MOST_UNDO :], self._state]
            self._state, self._last, self._dragged = state, now, changed
            self._enable()
            self._changed(state)

    def _enable(self) -> None:
        """Disable the controls that have no effect."""
        self._undo.disabled = not self._past
        unused = self._sliders.without_effect(self._state)
        for name, handle in self._handles.items():
            handle.disabled = name in unused

"""A plan: which levels the surgeon fuses, what the spine should be after, and within what that may change."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import Annotated, ClassVar, Literal, TypeVar

from msgspec import Meta

from warp_trunk.case.anatomy import VERTEBRAE, rank, region
from warp_trunk.checking import check_fields
from warp_trunk.errors import InputError
from warp_trunk.io.file_access import parsed_number
from warp_trunk.io.records import as_record

Value = TypeVar("Value")


@dataclass(frozen=True)
class CurvePlan:
    """The targets of one curve; a target that is omitted is free.

    >>> wt.CurvePlan("T8", correction=0.65).derotation is None
    True
    """

    apex: str
    """A vertebra of the curve, whose rotation `derotation` and `rotation_after` are of; as a rule its apex."""
    _: KW_ONLY
    correction: Annotated[float, Meta(ge=0.0, le=1.0)] | None = None
    """Share of the Cobb angle that surgery takes away, 0 to 1."""
    cobb_after: Annotated[float, Meta(ge=-30.0, le=120.0)] | None = None
    """Or the Cobb angle after, between the end vertebrae before [degrees]; negative bends the other way."""
    derotation: Annotated[float, Meta(ge=0.0, le=1.0)] | None = None
    """Share of the apex' axial rotation that surgery takes away, 0 to 1."""
    rotation_after: Annotated[float, Meta(ge=-30.0, le=60.0)] | None = None
    """Or that rotation after [degrees], to the side it has before; negative turns to the other side."""

    def __post_init__(self) -> None:
        """Raises InputError for a value out of range, or a target given twice."""
        _check_level(self.apex, "curve: 'apex'")
        for share, after in (("correction", "cobb_after"), ("derotation", "rotation_after")):
            if getattr(self, share) is not None and getattr(self, after) is not None:
                raise InputError(f"curve {self.apex}: '{share}' and '{after}' say the same; give one of them")
        check_fields(self, f"curve {self.apex}")


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The intended surgery; `uiv` and `liv` are needed.

    Angles are between vertebral axes, from endplate centre to endplate centre.

    >>> plan = wt.Plan(uiv="T4", liv="L1", curves=[wt.CurvePlan("T8", correction=0.65, derotation=0.4)])
    >>> plan.moves
    True
    """

    uiv: str = ""
    """Upper instrumented vertebra, the highest that is fused."""
    liv: str = ""
    """Lower instrumented vertebra, the lowest that is fused."""
    curves: Sequence[CurvePlan] = ()
    """The targets of each curve; curves that are not listed have none."""
    kyphosis_T5_T12: Annotated[float, Meta(ge=0.0, le=90.0)] | None = None  # noqa: N815 - the clinic's name
    """Thoracic kyphosis after [degrees], seen from the side; kept when left out."""
    lordosis_L1_L5: Annotated[float, Meta(ge=0.0, le=90.0)] | None = None  # noqa: N815
    """Lumbar lordosis after [degrees], seen from the side; kept when left out."""
    unfused: Literal["follow", "fixed"] = "follow"
    """Segments outside the fusion: they follow with least motion, or keep their rotation."""
    spontaneous: Annotated[float, Meta(ge=0.0, le=1.0)] | None = None
    """Share of a curve outside the fusion that corrects by itself, 0 to 1; never more than the planned curves
    are corrected. What bent out on films of side bending when left out, without films three quarters of the share
    by which the planned curves are corrected."""
    balance: Literal["posture", "keep", "centre"] = "posture"
    """Where T1 stands in the coronal plane: where patients stand after such surgery, nearer the sacrum the more
    discs are free below the fusion, and to the convex side of a curve on which it ends; as far beside the sacrum
    as before; or over it."""
    sva_after: Annotated[float, Meta(ge=-150.0, le=150.0)] | None = None
    """How far T1 stands in front of the sacrum after [mm]; as far as before when left out."""
    file_keys: ClassVar[Mapping[str, str]] = {"curves": "curve"}  # plan.toml has a table [[curve]] for each

    def __post_init__(self) -> None:
        """Raises InputError for levels that are none, a value out of range, or two curves of one apex."""
        for name, example in (("uiv", "T4"), ("liv", "L1")):
            if not getattr(self, name):
                rule = "is missing; a plan says which levels are fused"
                raise InputError(f"plan: '{name}' {rule}, so add it, for example {example}")
        check_fields(self, "plan")
        object.__setattr__(self, "curves", tuple(self.curves))
        _check_level(self.uiv, "plan: 'uiv'")
        _check_level(self.liv, "plan: 'liv'")
        if rank(self.uiv) >= rank(self.liv):
            raise InputError(
                f"plan: 'uiv' must lie above 'liv', but {self.uiv} is not above {self.liv}; change them"
            )
        apices = [curve.apex for curve in self.curves]
        twice = [apex for apex in apices if apices.count(apex) > 1]
        if twice:
            raise InputError(f"plan: the curve of {twice[0]} is planned twice; give each curve once")

    @property
    def moves(self) -> bool:
        """Whether anything is asked for; without a target nothing moves."""
        asked = [value for curve in self.curves for value in dataclasses.astuple(curve)[1:]]
        asked += [self.kyphosis_T5_T12, self.lordosis_L1_L5, self.sva_after]
        return self.balance == "centre" or any(value is not None for value in asked)


def fused_levels(plan: Plan) -> tuple[str, ...]:
    """The vertebrae that a plan fuses, top to bottom.

    >>> from warp_trunk.bone_motion.plan import fused_levels
    >>> len(fused_levels(wt.Plan(uiv="T4", liv="L1")))
    10
    """
    first, last = rank(plan.uiv), rank(plan.liv)
    return tuple(level for level in VERTEBRAE if first <= rank(level) <= last)


def plan_words(plan: Plan) -> str:
    """A plan in one line for a reader."""
    parts = [f"{plan.uiv} to {plan.liv} joined ({len(fused_levels(plan))} vertebrae)"]
    for curve in plan.curves:
        asked = [
            (curve.correction, "{:.0%} of the Cobb angle corrected"),
            (curve.cobb_after, "Cobb angle {:.0f}° after"),
            (curve.derotation, "{:.0%} of the rotation corrected"),
            (curve.rotation_after, "rotation {:.0f}° after"),
        ]
        words = [text.format(value) for value, text in asked if value is not None]
        parts.append(f"curve at {curve.apex}: {', '.join(words) or 'no target'}")
    whole = [
        (plan.kyphosis_T5_T12, "kyphosis {:.0f}°"),
        (plan.lordosis_L1_L5, "lordosis {:.0f}°"),
        (plan.sva_after, "top of the spine {:.0f} mm in front of the sacrum"),
    ]
    parts += [text.format(value) for value, text in whole if value is not None]
    places = {"centre": "T1 over the sacrum", "keep": "T1 as far beside the sacrum as before"}
    parts += [places[plan.balance]] if plan.balance in places else []
    return "; ".join(parts).replace("%", " %")


def _check_level(level: object, what: str) -> None:
    if not (isinstance(level, str) and region(level)):
        raise InputError(f"{what} must be a vertebra such as T4 or L1, not {level!r}; correct it")


@dataclass(frozen=True, kw_only=True)
class Bound:
    """One share of a plan that is left open.

    >>> wt.Bound(apex="T8", target="correction", low=0.5, high=0.8).high
    0.8
    """

    apex: str
    """The curve, by the vertebra that the plan names it by."""
    target: Literal["correction", "derotation"]
    """correction or derotation."""
    low: Annotated[float, Meta(ge=0.0, le=1.0)]
    """Least share, 0 to 1."""
    high: Annotated[float, Meta(ge=0.0, le=1.0)]
    """Greatest share, 0 to 1."""

    def __post_init__(self) -> None:
        """Raises InputError for another target, shares out of range, or an empty range."""
        where = f"--within {self.apex}: '{self.target}'"
        check_fields(self, f"--within {self.apex}")
        if not self.low < self.high:
            raise InputError(
                f"{where} must go from a smaller share to a larger one within 0 to 1, not from {self.low:g} to "
                f"{self.high:g}; correct it, or leave out what is not to change"
            )


def bounds_of_text(text: str) -> tuple[Bound, ...]:
    """The bounds of one curve as the command line has them: T8,correction=0.5..0.8,derotation=0.2..0.6.

    Raises:
        InputError: a range that is none, or a bound that is not allowed.
    """
    apex, targets = targets_of_text("--within", text, _range, "two numbers, as correction=0.5..0.8")
    if not targets:
        raise InputError(f"--within {text}: bounds nothing; write what may change, as {apex},correction=0.5..0.8")
    bounds = (
        {"apex": apex, "target": target, "low": low, "high": high} for target, (low, high) in targets.items()
    )
    return tuple(as_record(bound, Bound, f"--within {text}") for bound in bounds)


def _range(text: str) -> tuple[float, float]:
    low, high = map(parsed_number, text.split(".."))
    return low, high


def targets_of_text(
    option: str, text: str, value: Callable[[str], Value], cure: str
) -> tuple[str, dict[str, Value]]:
    """The apex of a curve and the values of its targets, as the command line has them: T8,correction=0.65.

    Args:
        option: whose text it is.
        text: the text.
        value: reads what stands behind a =; ValueError where it cannot.
        cure: what must stand there.

    Raises:
        InputError: a part that is no name and value, or a name that is given twice.
    """
    apex, *parts = (part.strip() for part in text.split(","))
    targets: dict[str, Value] = {}
    for part in parts:
        name, _, said = (word.strip() for word in part.partition("="))
        if name in targets:
            raise InputError(f"{option} {text}: '{name}' is given twice; give it once")
        try:
            targets[name] = value(said)
        except ValueError:
            raise InputError(f"{option} {text}: '{part}' must be a name, = and {cure}") from None
    return apex, targets


def check_bounds(plan: Plan, bounds: Sequence[Bound]) -> None:
    """Raise InputError for no bounds, two of one share, or one of a share that the plan does not give."""
    if not bounds:
        raise InputError("--within: says nothing; give what may change, as T8,correction=0.5..0.8")
    named = [(bound.apex, bound.target) for bound in bounds]
    for bound in bounds:
        where = f"--within {bound.apex}: '{bound.target}'"
        if named.count((bound.apex, bound.target)) > 1:
            raise InputError(f"{where} is bounded twice; give each bound once")
        if _share_of(plan, bound) is None:
            raise InputError(
                f"{where} is not in the plan, which is the reference of the search; "
                f"give it there, as --curve {bound.apex},{bound.target}={bound.high:g}"
            )


def bounded_shares(plan: Plan, bounds: Sequence[Bound]) -> tuple[float, ...]:
    """The value of a plan for each bound."""
    return tuple(_share_of(plan, bound) or 0.0 for bound in bounds)


def with_shares(plan: Plan, bounds: Sequence[Bound], shares: Sequence[float]) -> Plan:
    """The plan with other shares for its bounds."""
    curves = {curve.apex: curve for curve in plan.curves}
    for bound, share in zip(bounds, shares, strict=True):
        curves[bound.apex] = replace(curves[bound.apex], **{bound.target: float(share)})
    return replace(plan, curves=tuple(curves.values()))


def _share_of(plan: Plan, bound: Bound) -> float | None:
    return next((getattr(curve, bound.target) for curve in plan.curves if curve.apex == bound.apex), None)

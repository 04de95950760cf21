"""Within what a surgeon would let a plan be changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from warp_trunk.errors import InputError
from warp_trunk.io.file_access import number

from .record import Plan

TARGETS = ("correction", "derotation")
"""The targets of a curve that can be left open."""


@dataclass(frozen=True, kw_only=True)
class Bound:
    """One share of a plan that is left open."""

    apex: str
    """The curve, by the vertebra that the plan names it by."""
    target: str
    """correction or derotation."""
    low: float
    """Least share, 0 to 1."""
    high: float
    """Greatest share, 0 to 1."""

    def __post_init__(self) -> None:
        """Raises InputError for another target, shares out of range, or an empty range."""
        where = f"--within {self.apex}: '{self.target}'"
        if self.target not in TARGETS:
            raise InputError(f"{where} must be {' or '.join(TARGETS)}; correct it")
        if not 0.0 <= self.low < self.high <= 1.0:  # nor is NaN
            raise InputError(
                f"{where} must go from a smaller share to a larger one within 0 to 1, not from {self.low:g} to "
                f"{self.high:g}; correct it, or leave out what is not to change"
            )


def bounds_of_text(text: str) -> tuple[Bound, ...]:
    """The bounds of one curve as the command line has them: T8,correction=0.5..0.8,derotation=0.2..0.6.

    Raises:
        InputError: a range that is none, or a bound that is not allowed.
    """
    apex, *parts = (part.strip() for part in text.split(","))
    found = []
    for part in parts:
        target, _, ends = part.partition("=")
        try:
            low, high = map(number, ends.split(".."))
        except ValueError:
            raise InputError(
                f"--within {text}: '{part}' must be a name, = and two numbers, as correction=0.5..0.8"
            ) from None
        found.append(Bound(apex=apex, target=target.strip(), low=low, high=high))
    if not found:
        raise InputError(f"--within {text}: bounds nothing; write what may change, as {apex},correction=0.5..0.8")
    return tuple(found)


def check_bounds(plan: Plan, bounds: Sequence[Bound]) -> None:
    """Raise InputError for no bounds, two of one share, or one of a share that the plan does not give."""
    if not bounds:
        raise InputError("--within: says nothing; give what may change, as T8,correction=0.5..0.8")
    named = [(bound.apex, bound.target) for bound in bounds]
    for bound in bounds:
        where = f"--within {bound.apex}: '{bound.target}'"
        if named.count((bound.apex, bound.target)) > 1:
            raise InputError(f"{where} is bounded twice; give each bound once")
        if _given(plan, bound) is None:
            raise InputError(
                f"{where} is not in the plan, which is the reference of the search; "
                f"give it there, as --curve {bound.apex},{bound.target}={bound.high:g}"
            )


def shares_of(plan: Plan, bounds: Sequence[Bound]) -> tuple[float, ...]:
    """The value of a plan for each bound."""
    return tuple(_given(plan, bound) or 0.0 for bound in bounds)


def with_shares(plan: Plan, bounds: Sequence[Bound], shares: Sequence[float]) -> Plan:
    """The plan with other shares for its bounds."""
    curves = {curve.apex: curve for curve in plan.curves}
    for bound, share in zip(bounds, shares, strict=True):
        curves[bound.apex] = replace(curves[bound.apex], **{bound.target: float(share)})
    return replace(plan, curves=tuple(curves.values()))


def _given(plan: Plan, bound: Bound) -> float | None:
    return next((getattr(curve, bound.target) for curve in plan.curves if curve.apex == bound.apex), None)

"""Types, bounds and words of fields and arguments, which their annotations state, checked before any work.

May import `errors` and `system`.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, wraps
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    ParamSpec,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np

from .errors import InputError, WrongTypeError, closest_name, within

Parameters = ParamSpec("Parameters")
Returned = TypeVar("Returned")
_WORDS: dict[Any, str] = {
    float: "a number", int: "a whole number", bool: "True or False", str: "a text", Path: "a path",
    Sequence: "a list", list: "a list", tuple: "a list", Mapping: "a table", dict: "a table",
    Callable: "a function",
}  # fmt: skip
"""Types as messages have them."""
_CURES = {
    "Case": "read it with read_case",
    "Surface": "read it with read_surface",
    "Landmarks": "read them with read_landmarks",
    "Plan": 'give wt.Plan(uiv="T4", liv="L1", ...), or read it with read_plan',
    "CurvePlan": 'give a list such as [wt.CurvePlan("T8", correction=0.65)]',
    "Result": "read it with read_result",
    "PreparedPatient": "make it with patient_of",
    "ndarray": "give numpy.array(...)",
    "TrunkMesh": "take that of patient_of",
    "Mapping": "give a dictionary by name",
}
"""Where values of types that have no constructor of few words come from."""


def checked(function: Callable[Parameters, Returned]) -> Callable[Parameters, Returned]:
    """The function, which raises InputError for an argument that is not of its annotation, before it begins, and
    gets lists as the arrays that it is annotated with (`Array`)."""
    signature, name = inspect.signature(function), function.__name__

    @wraps(function)
    def call(*arguments: Parameters.args, **named: Parameters.kwargs) -> Returned:
        hints, bound = _hints_of(function), signature.bind(*arguments, **named)
        for argument, value in bound.arguments.items():
            if argument in hints:
                bound.arguments[argument] = _as_hinted(value, hints[argument], name, argument)
        return function(*bound.args, **bound.kwargs)

    return call


def check_fields(record: object, what: str) -> None:
    """InputError, which begins with `what`, for a field of another type than its annotation, or out of the bounds
    or the words there. Lists become the arrays that are annotated (`Array`), and tuples.

    For records that are made in Python or of options; those of a file are checked by `as_record` before. The
    description of bounds is the unit.
    """
    for name, hint in _hints_of(type(record)).items():
        value = getattr(record, name)
        if (fitting := _as_hinted(value, hint, what, name)) is not value:
            _setter_of(type(record))(record, name, fitting)


@cache
def _setter_of(kind: type) -> Callable[[Any, str, object], None]:
    """The function that sets a field of a frozen record: a dataclass, or of msgspec, which the engine lacks."""
    if not hasattr(kind, "__struct_fields__"):
        return object.__setattr__
    from msgspec.structs import force_setattr

    return force_setattr


@dataclass(frozen=True)
class Array:
    """Shape and numbers of an array, beside its type: `Annotated[np.ndarray, Array(None, 3)]`."""

    shape: tuple[int | None, ...]
    """None is any length."""
    kind: type[np.generic]
    """Of its numbers: np.float64, or np.int32 for whole ones."""
    finite: bool
    """Whether all numbers must be finite."""

    def __init__(self, *shape: int | None, kind: type[np.generic] = np.float64, finite: bool = True) -> None:
        object.__setattr__(self, "shape", shape)
        object.__setattr__(self, "kind", kind)
        object.__setattr__(self, "finite", finite)

    def of(self, value: object, name: str) -> np.ndarray:
        """The array of nested lists, or of an array of other numbers.

        Raises:
            InputError: `name` is something else, or of another shape.
        """
        whole = issubclass(self.kind, np.integer)
        words = "whole numbers" if whole else "numbers"
        rule = f"{name} must be {words} of shape {_shape(self.shape)}"
        try:
            array = np.asarray(value)
        except ValueError:  # rows of several lengths
            raise InputError(f"{rule}, and its rows differ in length; correct it") from None
        if array.shape == (0,):
            array = array.astype(self.kind).reshape([length or 0 for length in self.shape])
        if array.dtype.kind not in ("iu" if whole else "iuf"):
            raise WrongTypeError(f"{rule}, not {_shown(value)}; give numpy.array(...)")
        if len(array.shape) != len(self.shape) or any(
            want not in (None, has) for want, has in zip(self.shape, array.shape, strict=True)
        ):
            raise InputError(f"{rule}, not {_shape(array.shape)}; correct it")
        array = np.asarray(array, dtype=self.kind)
        if self.finite and not np.isfinite(array).all():
            row = int(np.argmin(np.isfinite(array).reshape(len(array), -1).all(axis=1)))
            raise InputError(f"{rule}, all finite, but number {row} is {array[row].tolist()}; leave it out")
        return array


def bounds_of(kind: type) -> dict[str, tuple[float, float]]:
    """Least and most value of the fields of a dataclass that have them: `Annotated[float, Meta(ge=, le=)]`, or
    with `Limits` of the engine."""
    return {name: (meta.ge, meta.le) for name, meta in _metadata(kind).items()}


def units_of(kind: type) -> dict[str, str]:
    """Units of the fields of a dataclass that have one."""
    return {name: meta.description for name, meta in _metadata(kind).items() if meta.description}


def _shown(value: object) -> str:
    """A value as messages show it: text, numbers and None themselves, of anything else the type."""
    if isinstance(value, str):
        return f"{value[:40]!r}"
    return f"{value}" if value is None or isinstance(value, Real) else type(value).__name__


@cache
def _hints_of(of: Any) -> dict[str, Any]:
    """The types that the annotations of a function or a class allow, by name."""
    hints = get_type_hints(of, include_extras=True)
    return {name: hint for name, hint in hints.items() if name not in ("return", "_") and not _is_of_class(hint)}


def _is_of_class(hint: Any) -> bool:
    return get_origin(hint) is ClassVar


def _metadata(kind: type) -> dict[str, Any]:
    return {
        name: meta
        for name, hint in _hints_of(kind).items()
        for part in (hint, *get_args(hint))
        for meta in getattr(part, "__metadata__", ())
        if not isinstance(meta, Array)
    }


def _as_hinted(value: Any, hint: Any, what: str, name: str) -> Any:
    """The value as a hint has it; InputError, which names `what` and `name`, for one that it does not allow."""
    kinds = _alternatives(hint)
    kind = next((kind for kind in kinds if _is_a(value, kind)), None)
    if kind is None:
        raise WrongTypeError(
            f"{what}: '{name}' must be {_words(kinds)}, not {_shown(value)}; {_cure(value, kinds)}"
        )
    if get_origin(kind) is Annotated:
        for meta in kind.__metadata__:
            if isinstance(meta, Array):
                return meta.of(value, f"{what}: '{name}'")
            _check_bounds(value, meta, f"{what}: '{name}'")
        kind = get_args(kind)[0]
    members = get_args(kind)
    if get_origin(kind) is Literal and value not in members:
        rule = f"must be {' or '.join(members)}, not {value!r}{closest_name(value, members)}"
        raise InputError(f"{what}: '{name}' {rule}; give one of them")
    if _outer(kind) in (Mapping, dict) and members:
        for key, member in value.items():
            _as_hinted(key, members[0], what, f"{name}, name")
            _as_hinted(member, members[1], what, f"{name}[{key}]")
    elif _outer(kind) in (Sequence, list, tuple) and members:
        count = len(members) if _outer(kind) is tuple and Ellipsis not in members else None
        if count not in (None, len(value)):
            raise InputError(f"{what}: '{name}' must have {count} members, not {len(value)}; correct it")
        if members[0] in (str, float) and count is None and all(type(member) is members[0] for member in value):
            return tuple(value) if _outer(kind) is tuple else value
        kinds = members[:1] * len(value) if count is None else members
        fitting = [
            _as_hinted(member, kind, what, f"{name}[{number}]")
            for number, (member, kind) in enumerate(zip(value, kinds, strict=True))
        ]
        return tuple(fitting) if _outer(kind) is tuple else value
    return Path(value) if kind is Path else value


def _is_a(value: object, kind: Any) -> bool:
    """Whether a value is of the outermost type of a hint."""
    outer = _outer(kind)
    if any(isinstance(meta, Array) for meta in getattr(kind, "__metadata__", ())):
        return _is_list(value)
    if outer is None or outer is NoneType:
        return value is None
    if outer is Any or isinstance(outer, TypeVar):
        return True
    if outer is Literal:
        return isinstance(value, str)
    if outer in (float, int):
        return isinstance(value, Real if outer is float else Integral) and not isinstance(value, bool)
    if outer is bool:
        return isinstance(value, bool | np.bool_)
    if outer in (Sequence, list, tuple):
        return _is_list(value)
    return isinstance(value, {dict: Mapping, Path: str | Path}.get(outer, outer))


def _is_list(value: object) -> bool:
    return isinstance(value, Sequence | np.ndarray) and not isinstance(value, str | bytes)


@cache
def _alternatives(hint: Any) -> tuple[Any, ...]:
    """The types that a hint allows."""
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def _outer(kind: Any) -> Any:
    """The type of a hint without its members."""
    return _outer(get_args(kind)[0]) if get_origin(kind) is Annotated else get_origin(kind) or kind


def _words(kinds: Sequence[Any]) -> str:
    """The names of some types in a message."""
    outer = [_outer(kind) for kind in kinds if _outer(kind) not in (None, NoneType)]
    if str in outer and Path in outer:
        outer = [kind for kind in outer if kind is not str]
    texts = [" or ".join(get_args(kind)) for kind in kinds if _outer(kind) is Literal] + [
        _WORDS[kind] for kind in outer if kind in _WORDS
    ]
    names = [kind.__name__ for kind in outer if kind not in _WORDS and kind is not Literal]
    words = [*(["of type " + " or ".join(names)] if names else []), *dict.fromkeys(texts)]
    return " or ".join(words) + (", as text or pathlib.Path" if Path in outer else "")


def _cure(value: object, kinds: Sequence[Any]) -> str:
    outer = next(_outer(kind) for kind in kinds)
    if outer is int and isinstance(value, Real) and math.isfinite(value):
        return f"give {round(float(value))}"
    if outer in (Sequence, list, tuple) and (members := get_args(kinds[0])):
        if any(_is_a(value, kind) for kind in _alternatives(members[0])):
            return "give a list of it, in brackets"
        outer = _outer(_alternatives(members[0])[0])
    name = getattr(outer, "__name__", "")
    return _CURES.get(name, "give one" if outer in _WORDS or outer is Literal else f"give wt.{name}(...)")


def _check_bounds(value: Any, limits: Any, name: str) -> None:
    """InputError for a number that is out of its bounds, or none."""
    number = float(value)
    if limits.ge <= number <= limits.le and not math.isinf(number):
        return
    nearest = min(max(number, limits.ge), limits.le)
    cure = within(number, nearest) if math.isfinite(nearest) else "; give one"
    finite = f"a finite number of at least {limits.ge:g}"
    rule = finite if math.isinf(limits.le) else f"a number from {limits.ge:g} to {limits.le:g}"
    raise InputError(f"{name} must be {' '.join(filter(None, (rule, limits.description)))}, not {value}{cure}")


def _shape(shape: Sequence[int | None]) -> str:
    return str(tuple(shape)).replace("None", "n")

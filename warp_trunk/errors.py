"""The one error for bad input: its text names the file or argument, the rule, the value found and the cure."""

import difflib
import math
import re
from collections.abc import Iterable
from numbers import Real
from pathlib import Path
from types import UnionType

_UNSEEN = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")


class InputError(ValueError):
    """Something given to the program breaks a stated rule; the command line ends with status 2.

    >>> wt.simulate(case, tets=-1)
    Traceback (most recent call last):
    warp_trunk.errors.InputError: mesh: 'tets' must be a number from 4 to 5e+07, not -1; the nearest is 4
    """

    def __str__(self) -> str:
        """One line, also where a name or a value in it holds line breaks or what no terminal can show."""
        return _UNSEEN.sub(lambda found: found[0].encode("unicode_escape").decode(), super().__str__())


def expect(value: object, kind: type | UnionType, name: str, cure: str) -> None:
    """Raise InputError, which begins with `name`, for a value of another type; `cure` says where to get one."""
    if not isinstance(value, kind):
        wanted = getattr(kind, "__name__", kind)
        raise InputError(f"{name} must be of type {wanted}, not {type(value).__name__}; {cure}")


def as_path(given: object, name: str) -> Path:
    """A path that was given as text or pathlib.Path; InputError, which begins with `name`, for anything else."""
    if isinstance(given, str | Path):
        return Path(given)
    raise InputError(f"{name} must be a path, as text or pathlib.Path, not {type(given).__name__}; give one")


def check_ranges(options: object, what: str, unit: str = "", **ranges: tuple[float, float]) -> None:
    """Raise InputError for a number among the fields of some options that is not within its range, nor None.

    `what` is the first word of the message, `unit` follows a blank, `ranges` are by the name of the field."""
    for name, (least, most) in ranges.items():
        value = getattr(options, name)
        if value is None:
            continue
        known = isinstance(value, Real) and not math.isnan(value)
        if not known or not least <= float(value) <= most:
            cure = within(float(value), min(max(float(value), least), most)) if known else "; give one"
            raise InputError(
                f"{what}: '{name}' must be a number from {least:g} to {most:g}{unit}, not {value}{cure}"
            )


def within(value: float, bound: float) -> str:
    """The cure for a number beyond a bound, as the end of a sentence; a share may be meant in percent."""
    if bound == 1.0 and 1.0 < value <= 100.0:
        return f"; for {value:g} % write {value / 100.0:g}"
    return f"; the nearest is {bound:g}"


def check_choices(options: object, what: str, **choices: Iterable[str]) -> None:
    """Raise InputError for a word among the fields of some options that is none of its choices, nor None."""
    for name, allowed in choices.items():
        value = getattr(options, name)
        if value is not None and value not in tuple(allowed):
            raise InputError(f"{what}: '{name}' must be {' or '.join(allowed)}, not {value!r}")


def nearest(word: str, known: Iterable[str]) -> str:
    """A question for the known word that is most like a word; empty where none is."""
    near = difflib.get_close_matches(word, list(known), n=1, cutoff=0.5)
    return f" (did you mean '{near[0]}'?)" if near else ""

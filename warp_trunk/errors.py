"""The one error for bad input: its text names the file or argument, the rule, the value found and the cure.

Imports no other part of the program.
"""

import difflib
import re
from collections.abc import Iterable

_UNSEEN = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")


class InputError(ValueError):
    """Something given to the program breaks a stated rule; the command line ends with status 2.

    A value of a wrong type is also a TypeError, a missing file a FileNotFoundError.

    >>> wt.MeshOptions(tets=-1)
    Traceback (most recent call last):
    warp_trunk.errors.InputError: mesh: 'tets' must be a number from 4 to 5e+07, not -1; the nearest is 4
    """

    def __str__(self) -> str:
        """One line, also where a name or a value in it holds line breaks or what no terminal can show."""
        return _UNSEEN.sub(lambda match: match[0].encode("unicode_escape").decode(), super().__str__())


class WrongTypeError(InputError, TypeError):
    """A value of a type that cannot be used."""


class MissingFileError(InputError, FileNotFoundError):
    """A file or a folder that does not exist."""


def within(value: float, bound: float) -> str:
    """The cure for a number beyond a bound, as the end of a sentence; a share may be meant in percent."""
    if bound == 1.0 and 1.0 < value <= 100.0:
        return f"; for {value:g} % write {value / 100.0:g}"
    return f"; the nearest is {bound:g}"


def closest_name(word: str, names: Iterable[str]) -> str:
    """A question for the known word that is most like a word; empty where none is."""
    near = difflib.get_close_matches(word, list(names), n=1, cutoff=0.5)
    return f" (did you mean '{near[0]}'?)" if near else ""

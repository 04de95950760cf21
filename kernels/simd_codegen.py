"""C++ vector code from the formulas of Warp functions, for several tetrahedra at a time on the CPU.

Warp compiles its functions for one item, to scalar instructions. Called with expressions in place of numbers, the
same functions record what they compute (operator overloading); `emit` writes that record as C++ in which every
number is a vector, a *lane* of which belongs to one item. A formula that depends on a comparison uses `wp.where`,
because lanes take different branches."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from types import CellType, FunctionType, SimpleNamespace
from typing import Any, Self

import warp as wp

LANES = 8
"""Numbers computed at once: those of one or two vector registers."""
TYPES = """
    typedef real lanes __attribute__((ext_vector_type(8)));
    typedef double wides __attribute__((ext_vector_type(8)));
    const auto each = [](auto function, auto x) {
        for (int k = 0; k < 8; ++k) x[k] = function(x[k]);
        return x;
    };
    const auto read = [](const real* x, int of, int k) {
        return lanes{x[k], x[of + k], x[2 * of + k], x[3 * of + k],
                     x[4 * of + k], x[5 * of + k], x[6 * of + k], x[7 * of + k]};
    };
"""
"""Helpers of the generated C++; `read` takes number k of eight items of `of` numbers each."""


class Number:
    """An expression: a constant, or C++ with a {} for each operand."""

    cpp = "lanes"
    """The C++ type of its value."""

    def __init__(self, value: float | str | Number, *operands: Number) -> None:
        """A number of another precision is converted."""
        if isinstance(value, Number):
            value, operands = f"__builtin_convertvector({{}}, {self.cpp})", (value,)
        self.value, self.operands = value, operands

    def __add__(self, other: Self) -> Self:
        if self.value == 0.0 or other.value == 0.0:  # of what a matrix has nothing of
            return other if self.value == 0.0 else self
        return type(self)("{} + {}", self, other)

    def __sub__(self, other: Self) -> Self:
        if self.value == 0.0 or other.value == 0.0:
            return -other if self.value == 0.0 else self
        return type(self)("{} - {}", self, other)

    def __mul__(self, other: Any) -> Any:
        if not isinstance(other, Number):
            return NotImplemented
        if self.value == 0.0 or other.value == 1.0:
            return self
        if other.value == 0.0 or self.value == 1.0:
            return other
        return type(self)("{} * {}", self, other)

    def __truediv__(self, other: Self) -> Self:
        return type(self)("{} / {}", self, other)

    def __neg__(self) -> Self:
        return self if self.value == 0.0 else type(self)("-{}", self)

    def __gt__(self, other: Number) -> Condition:
        return Condition("{} > {}", self, other)

    def __lt__(self, other: Number) -> Condition:
        return Condition("{} < {}", self, other)


class Wide(Number):
    """In double precision, whatever the others are in."""

    cpp = "wides"


class Condition(Number):
    """Whether something holds, in each lane."""

    cpp = "auto"

    def __bool__(self) -> bool:
        raise TypeError("lanes differ in what holds; write wp.where")


class Numbers:
    """A vector, or a matrix as the vector of its rows."""

    def __init__(self, *parts: Any) -> None:
        self.parts = list(parts)

    def __getitem__(self, at: int | tuple[int, int]) -> Any:
        return self.parts[at[0]][at[1]] if isinstance(at, tuple) else self.parts[at]

    def __setitem__(self, at: int, value: Any) -> None:
        self.parts[at] = value

    def __len__(self) -> int:
        return len(self.parts)

    def __add__(self, other: Numbers) -> Numbers:
        return Numbers(*(a + b for a, b in zip(self.parts, other.parts, strict=True)))

    def __sub__(self, other: Numbers) -> Numbers:
        return Numbers(*(a - b for a, b in zip(self.parts, other.parts, strict=True)))

    def __neg__(self) -> Numbers:
        return Numbers(*(-a for a in self.parts))

    def __truediv__(self, by: Number) -> Numbers:
        return Numbers(*(a / by for a in self.parts))

    def __rmul__(self, by: Number) -> Numbers:
        return Numbers(*(by * a for a in self.parts))

    def __mul__(self, other: Any) -> Numbers:
        """By a number; a matrix also by a vector or a matrix."""
        if isinstance(other, Number):
            return Numbers(*(a * other for a in self.parts))
        if isinstance(other[0], Number):
            return Numbers(*(_dot(row, other) for row in self.parts))
        columns = _transpose(other).parts
        return Numbers(*(Numbers(*(_dot(row, column) for column in columns)) for row in self.parts))


def _sum(numbers: Iterable[Any]) -> Any:
    first, *summands = numbers
    for other in summands:
        first = first + other
    return first


def _dot(a: Numbers, b: Numbers) -> Any:
    return _sum(x * y for x, y in zip(a.parts, b.parts, strict=True))


def _cross(a: Numbers, b: Numbers) -> Numbers:
    return Numbers(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _transpose(m: Numbers) -> Numbers:
    return Numbers(*(Numbers(*column) for column in zip(*(row.parts for row in m.parts), strict=True)))


def _identity(n: int, dtype: type) -> Numbers:
    return Numbers(*(Numbers(*(dtype(float(i == j)) for j in range(n))) for i in range(n)))


def _skew(v: Numbers) -> Numbers:
    zero = type(v[0])(0.0)
    return Numbers(Numbers(zero, -v[2], v[1]), Numbers(v[2], zero, -v[0]), Numbers(-v[1], v[0], zero))


def _where(condition: Condition, then: Any, otherwise: Any) -> Any:
    if isinstance(then, Numbers):
        pairs = zip(then.parts, otherwise.parts, strict=True)
        return Numbers(*(_where(condition, a, b) for a, b in pairs))
    return type(then)("{} ? {} : {}", condition, then, otherwise)


def _of_each(name: str) -> Callable[[Number], Number]:
    """A function of Warp that no vector instruction computes."""
    return lambda x: type(x)(f"each([](auto y) {{{{ return wp::{name}(y); }}}}, {{}})", x)


def _built_in(name: str) -> Callable[..., Number]:
    return lambda *x: type(x[0])(f"__builtin_elementwise_{name}({', '.join(['{}'] * len(x))})", *x)


_least, _largest, _root = _built_in("min"), _built_in("max"), _built_in("sqrt")
_MEANING = SimpleNamespace(
    dot=_dot,
    ddot=lambda a, b: _sum(_dot(x, y) for x, y in zip(a.parts, b.parts, strict=True)),
    cross=_cross,
    outer=lambda a, b: Numbers(*(x * b for x in a.parts)),
    length=lambda v: _root(_dot(v, v)),
    trace=lambda m: _sum(m[k][k] for k in range(len(m))),
    determinant=lambda m: _dot(m[0], _cross(m[1], m[2])),
    transpose=_transpose,
    identity=_identity,
    skew=_skew,
    matrix_from_rows=Numbers,
    where=_where,
    sqrt=_root,
    min=_least,
    max=_largest,
    clamp=lambda x, low, high: _least(_largest(x, low), high),
    **{name: _of_each(name) for name in ("acos", "cos", "sin", "log")},
    float64=Wide,
    static=lambda value: value,
)
"""The meaning of the names of Warp for lanes."""


def vectorized(function: wp.Function) -> Callable[..., Any]:
    """A function of Warp that computes with `Number` and `Numbers`."""
    original: Any = function.func
    assert isinstance(original, FunctionType)
    used = {name: value for name, value in original.__globals__.items() if name in original.__code__.co_names}
    names = {name: _meaning(value) for name, value in used.items()}
    cells = tuple(CellType(_meaning(cell.cell_contents)) for cell in original.__closure__ or ())
    translated = FunctionType(original.__code__, names, original.__name__, original.__defaults__, cells)

    def call(*arguments: Any) -> Any:
        return translated(*(Numbers(*a.parts) if isinstance(a, Numbers) else a for a in arguments))

    return call


def _meaning(value: Any) -> Any:
    if value is wp:
        return _MEANING
    if isinstance(value, wp.Function):
        return lambda *arguments: vectorized(value)(*arguments)
    if value in (wp.float32, wp.float64):
        return Number
    if isinstance(value, type) and hasattr(value, "_wp_scalar_type_"):
        return Numbers
    return Number(float(value)) if isinstance(value, wp.float32 | wp.float64) else value


def emit(results: Sequence[Number]) -> tuple[str, list[str]]:
    """C++ that computes some numbers, each expression once, and the names of the results there."""
    lines: list[str] = []
    names: dict[Number, str] = {}
    waiting = list(reversed(results))
    while waiting:
        number = waiting[-1]
        missing = [operand for operand in number.operands if operand not in names]
        if missing:
            waiting += reversed(missing)
            continue
        waiting.pop()
        if number in names:
            continue
        names[number] = f"v{len(names)}"
        if isinstance(number.value, str):
            text = number.value.format(*(names[operand] for operand in number.operands))
        else:
            text = f"({number.cpp})({number.value!r})"
        lines.append(f"const {number.cpp} {names[number]} = {text};")
    return "\n".join(lines), [names[result] for result in results]

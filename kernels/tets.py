"""Kernels over the tetrahedra of an energy: from its formulas to energies with gradients, and Hessians.

An energy states two functions of one tetrahedron (`TetFormulas`). On CUDA a thread evaluates one tetrahedron. On
the CPU the same functions are translated to vector instructions (`simd_codegen`): with one tetrahedron at a time a
relaxation takes 1.4 (neo-Hookean) to 1.7 (itmsm) times as long. Energies are summed in double precision, in one
slab for each range of tetrahedra."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from types import SimpleNamespace
from typing import Any

import warp as wp

from .arguments import Corners, Flags, Items, Sums, array_types, filled
from .assembly import (
    FIRST_TERM,
    INVERTED,
    NEWLY_INVERTED,
    PAIRS,
    Places,
    add_gradient,
    block_sums_type,
    hessian_adder,
    with_corner_0,
)
from .native import native_kernel, real
from .simd_codegen import LANES, TYPES, Number, Numbers, emit, vectorized
from .vectors import sums_reducer


@dataclass(frozen=True)
class Field:
    """An array of an energy, with as many items as there are tetrahedra."""

    item: Any
    """Type of its items."""
    each: int = 1
    """How many a tetrahedron has, as the array's second dimension where they are more than one."""

    @property
    def array(self) -> Any:
        """Type of the array."""
        return wp.array(dtype=self.item, ndim=2 if self.each > 1 else 1)

    @property
    def numbers(self) -> int:
        """Numbers of an item."""
        return getattr(self.item, "_length_", 1)


@dataclass(frozen=True, eq=False)
class TetFormulas:
    """The formulas of an energy in one precision."""

    name: str
    """Name of the module of its kernels, which are compiled together."""
    scalar: Any
    """wp.float32 or wp.float64."""
    fields: Mapping[str, Field]
    """Its arrays."""
    elements: Any
    """A struct of them, by `struct_of`."""
    evaluate: wp.Function
    """Of `elements`, a tetrahedron and the displacements of its corners: energies by term, as a vector; the
    relative change of volume, -1 or less where inverted; and the gradients of the four corners."""
    hessian: wp.Function
    """Of the same, and whether it is made positive semidefinite: the second derivatives aa, ab, ac, bb, bc, cc in
    the edge vectors a, b, c from corner 0."""
    columns: Sequence[int]
    """Columns of the sums of those terms that are on."""

    def bundle(self, energy: Any) -> Any:
        """The struct of the arrays that an energy has by the fields' names."""
        return filled(self.elements, **{name: getattr(energy, name) for name in self.fields})


def struct_of(fields: Mapping[str, Field]) -> Any:
    """The arrays of an energy as one argument of a kernel."""
    annotations = {name: field.array for name, field in fields.items()}
    return wp.struct(type("Elements", (), {"__annotations__": annotations, "__module__": __name__}))


@wp.func
def gravity_term(u0: Any, u1: Any, u2: Any, u3: Any, weight: Any):
    """Potential of a tetrahedron's four quarter masses, weight * (sum of heights), from the rest position.

    The weight is alpha m_i / (M_0 H_0), the force on each corner along +z.
    """
    return weight * (u0[2] + u1[2] + u2[2] + u3[2])


def tet_kernels(formulas: TetFormulas, cuda: bool, *, items: bool = False) -> SimpleNamespace:
    """The kernels `gradient` (with the energy), `projected_hessian` (made positive) and `hessian`; and `bundle`.

    On the CPU they are loops over a range, unless there shall be `items`, one for each tetrahedron as on CUDA.
    """
    loops = not (cuda or items)
    return SimpleNamespace(
        gradient=_gradient(formulas, cuda, loops),
        projected_hessian=_hessian(formulas, cuda, loops, positive=True),
        hessian=_hessian(formulas, cuda, loops, positive=False),
        bundle=formulas.bundle,
    )


def _kernel(formulas: TetFormulas, cuda: bool, loop: str | None) -> Callable[[Any], wp.Kernel]:
    """Makes a kernel of what one tetrahedron does, or of the code of a loop in its place."""
    if loop is not None:
        return native_kernel(f"{formulas.name}_loops", loop)
    return wp.kernel(module=f"{formulas.name}_items_{'cuda' if cuda else 'cpu'}", enable_backward=False)


def _gradient(formulas: TetFormulas, cuda: bool, loop: bool) -> wp.Kernel:
    scalar, evaluate, elements_type = formulas.scalar, formulas.evaluate, formulas.elements
    used = max(formulas.columns) + 1
    add, sums_type = sums_reducer(used), wp.types.vector(used, wp.float64)
    _, Vectors, _ = array_types(scalar)
    Slabs = wp.array2d[wp.types.vector(3, scalar)]

    @_kernel(formulas, cuda, gradient_code(formulas) if loop else None)
    def gradient(
        items: Items,
        tets: Corners,
        elements: elements_type,
        inverted_before: Flags,
        displacement: Vectors,
        gradient: Slabs,
        inverted: Flags,
        sums: Sums,
    ):
        t = items.first + wp.tid()
        contributions = sums_type()
        if t < items.end:
            n = tets[t]
            e, growth, g0, g1, g2, g3 = evaluate(
                elements, t, displacement[n[0]], displacement[n[1]], displacement[n[2]], displacement[n[3]]
            )
            add_gradient(gradient, items.slab, n, g0, g1, g2, g3)
            for k in range(FIRST_TERM, wp.static(used)):
                contributions[k] = wp.float64(e[k - FIRST_TERM])
            is_inverted = wp.int8(0)
            if not (growth > scalar(-1.0)):  # so written, a volume that is not a number counts, too
                is_inverted = wp.int8(1)
                contributions[INVERTED] = wp.float64(1.0)
                if inverted_before[t] == wp.int8(0):
                    contributions[NEWLY_INVERTED] = wp.float64(1.0)
            inverted[t] = is_inverted
        add(sums, items.slab, 0, contributions)

    return gradient


def _hessian(formulas: TetFormulas, cuda: bool, loop: bool, positive: bool) -> wp.Kernel:
    find_hessian, elements_type = formulas.hessian, formulas.elements
    add_hessian, blocks_type = hessian_adder(formulas.scalar, cuda), block_sums_type(formulas.scalar, cuda)
    _, Vectors, _ = array_types(formulas.scalar)
    clip = wp.constant(positive)

    @_kernel(formulas, cuda, hessian_code(formulas, positive=positive) if loop else None)
    def hessian(
        items: Items,
        tets: Corners,
        elements: elements_type,
        place_of: Places,
        displacement: Vectors,
        blocks: blocks_type,
    ):
        item = items.first + wp.tid()
        t = wp.min(item, items.end - 1)  # all threads of a warp store together, those past the end as well
        n = tets[t]
        aa, ab, ac, bb, bc, cc = find_hessian(
            elements, t, displacement[n[0]], displacement[n[1]], displacement[n[2]], displacement[n[3]], clip
        )
        add_hessian(blocks, item, t, place_of, aa, ab, ac, bb, bc, cc)

    return hessian


TET = "t"
"""Stands for the tetrahedra in the lanes."""


BEGIN = f"""
    const wp::int32* corners = (const wp::int32*)tets.data;
    const real* at = (const real*)displacement.data;
    for (wp::int32 t = first; t < end; t += {LANES}) {{
        const int count = end - t < {LANES} ? end - t : {LANES};
        const auto window = [&](const auto* from, int of, auto* spare) {{
            if (count == {LANES}) return from + (wp::int64)of * t;
            for (int l = 0; l < {LANES}; ++l)
                for (int k = 0; k < of; ++k)
                    spare[of * l + k] = from[(wp::int64)of * (t + (l < count ? l : 0)) + k];
            return (decltype(from))spare;
        }};
        wp::int32 spare_corners[{4 * LANES}];
        const wp::int32* n = window(corners, 4, spare_corners);
        const auto moved = [&](int a, int k) {{
            return lanes{{{", ".join(f"at[3 * n[{4 * lane} + a] + k]" for lane in range(LANES))}}};
        }};
"""
"""Begins a loop over the tetrahedra, so many at a time. The last ones may be fewer than there are lanes: what is
read of them is then a copy, filled up with the first. `moved` is number k of the displacements of corner a."""

SCATTER_GRADIENT = """
        for (int l = 0; l < count; ++l) {  // one after the other: tetrahedra in the lanes share nodes
            for (int a = 0; a < 4; ++a) {
                real* to = out + 3 * n[4 * l + a];
                to[0] += forces[3 * a][l];
                to[1] += forces[3 * a + 1][l];
                to[2] += forces[3 * a + 2][l];
            }
            const bool is_inverted = !(growth[l] > -1);
            all_inverted += is_inverted;
            newly_inverted += is_inverted && inverted_before.data[t + l] == 0;
            inverted.data[t + l] = is_inverted;
        }
    }
"""

TRANSPOSE = f"""
    typedef real run __attribute__((ext_vector_type(8), aligned(sizeof(real))));
    lanes kept[{LANES}][{len(PAIRS) + -(-len(PAIRS) // LANES)}];
    const auto keep = [&](int k, lanes a, lanes b, lanes c, lanes d, lanes e, lanes f, lanes g, lanes h) {{
        const auto by_one = [](lanes x, lanes y) {{
            return __builtin_shufflevector(x, y, 0, 8, 1, 9, 4, 12, 5, 13);
        }};
        const auto of_two = [](lanes x, lanes y) {{
            return __builtin_shufflevector(x, y, 2, 10, 3, 11, 6, 14, 7, 15);
        }};
        const auto first_two = [](lanes x, lanes y) {{
            return __builtin_shufflevector(x, y, 0, 1, 8, 9, 4, 5, 12, 13);
        }};
        const auto last_two = [](lanes x, lanes y) {{
            return __builtin_shufflevector(x, y, 2, 3, 10, 11, 6, 7, 14, 15);
        }};
        const lanes ab = by_one(a, b), cd = by_one(c, d), ef = by_one(e, f), gh = by_one(g, h);
        const lanes ab2 = of_two(a, b), cd2 = of_two(c, d), ef2 = of_two(e, f), gh2 = of_two(g, h);
        const lanes low[4] = {{first_two(ab, cd), last_two(ab, cd), first_two(ab2, cd2), last_two(ab2, cd2)}};
        const lanes high[4] = {{first_two(ef, gh), last_two(ef, gh), first_two(ef2, gh2), last_two(ef2, gh2)}};
        for (int l = 0; l < 4; ++l) {{
            kept[l][k] = __builtin_shufflevector(low[l], high[l], 0, 1, 2, 3, 8, 9, 10, 11);
            kept[l + 4][k] = __builtin_shufflevector(low[l], high[l], 4, 5, 6, 7, 12, 13, 14, 15);
        }}
    }};
"""
"""`keep` stores eight numbers of every lane beside each other, as run k of what is kept of that lane."""

SCATTER_BLOCKS = f"""
        for (int l = 0; l < count; ++l) {{
            const real* ninth = (const real*)(kept[l] + {len(PAIRS)});
            const wp::int32* to = (const wp::int32*)place_of.data + {len(PAIRS)} * (wp::int64)(t + l);
            for (int k = 0; k < {len(PAIRS)}; ++k) {{
                const lanes own = kept[l][k];
                const lanes transposed = __builtin_shufflevector(own, own, 0, 3, 6, 1, 4, 7, 2, 5);
                real* block = out + 9 * (wp::int64)(to[k] / 2);
                *(run*)block += to[k] % 2 ? transposed : own;
                block[8] += ninth[k];
            }}
        }}
    }}
"""
"""Adds what is kept: of each block a run of eight numbers, and after all of them the ninth ones, which stay where
they are in the transposed block."""


class _Array:
    """An array of an energy as its formulas see it: [t] or [t, k] is what tetrahedra have."""

    def __init__(self, name: str, field: Field) -> None:
        self._name, self._field = name, field
        self.window: str | None = None
        """C++ that names what is read of it, as soon as something is."""

    def __getitem__(self, at: Any) -> Any:
        name, field = self._name, self._field
        of, k = field.each * field.numbers, at[1] if isinstance(at, tuple) else 0
        data = f"(const real*)elements.{name}.data"
        self.window = f"real spare_{name}[{LANES * of}]; const real* {name} = window({data}, {of}, spare_{name});"
        numbers = [Number(f"read({name}, {of}, {field.numbers * k + i})") for i in range(field.numbers)]
        return numbers[0] if field.numbers == 1 else Numbers(*numbers)


class _Elements:
    """The arrays of an energy, by name."""

    def __init__(self, formulas: TetFormulas) -> None:
        self.__dict__.update({name: _Array(name, field) for name, field in formulas.fields.items()})

    def windows(self) -> str:
        """C++ that names what is read of those that were asked for."""
        return "\n".join(array.window for array in self.__dict__.values() if array.window)


def _moved() -> list[Numbers]:
    return [Numbers(*(Number(f"moved({a}, {k})") for k in range(3))) for a in range(4)]


def gradient_code(formulas: TetFormulas) -> str:
    """C++ that adds energies, gradients and counts of tetrahedra `first` to `end`."""
    elements = _Elements(formulas)
    energies, growth, *forces = vectorized(formulas.evaluate)(elements, TET, *_moved())
    terms = [energies[column - FIRST_TERM] for column in formulas.columns]
    lines, names = emit([*terms, *(number for corner in forces for number in corner.parts), growth])
    numbered = ", ".join(map(str, range(LANES)))
    return "\n".join(
        [
            real(formulas.scalar) + TYPES,
            "real* out = (real*)((char*)gradient.data + slab * gradient.strides[0]);",
            "double* total = (double*)((char*)sums.data + slab * sums.strides[0]);",
            "wp::int32 all_inverted = 0, newly_inverted = 0;",
            *(f"wides sum{column} = 0;" for column in formulas.columns),
            BEGIN,
            elements.windows(),
            lines,
            f"const auto counted = lanes{{{numbered}}} < (lanes)((real)count);",
            *(
                f"sum{column} += __builtin_convertvector(counted ? {name} : (lanes)(0), wides);"
                for column, name in zip(formulas.columns, names, strict=False)
            ),
            f"const lanes forces[12] = {{{', '.join(names[-13:-1])}}}, growth = {names[-1]};",
            SCATTER_GRADIENT,
            f"total[{INVERTED}] += all_inverted; total[{NEWLY_INVERTED}] += newly_inverted;",
            *(f"for (int l = 0; l < {LANES}; ++l) total[{k}] += sum{k}[l];" for k in formulas.columns),
        ]
    )


def hessian_code(formulas: TetFormulas, *, positive: bool) -> str:
    """C++ that adds the second derivatives of tetrahedra `first` to `end` to the blocks of their corner pairs."""
    elements = _Elements(formulas)
    aa, ab, ac, bb, bc, cc = vectorized(formulas.hessian)(elements, TET, *_moved(), positive)
    oo, oa, ob, oc = vectorized(with_corner_0)(aa, ab, ac, bb, bc, cc)
    blocks = [oo, oa, ob, oc, aa, ab, ac, bb, bc, cc]
    axes = [(i, j) for i in range(3) for j in range(3)]
    numbers = [[block[i, j] for i, j in axes] for block in blocks]
    ninth = [block.pop() for block in numbers]
    lines, names = emit([*chain(*numbers), *ninth])
    names += [names[-1]] * (-len(names) % LANES)
    return "\n".join(
        [
            real(formulas.scalar) + TYPES,
            "real* out = (real*)blocks.data;",
            TRANSPOSE,
            BEGIN,
            elements.windows(),
            lines,
            *(f"keep({k // LANES}, {', '.join(names[k : k + LANES])});" for k in range(0, len(names), LANES)),
            SCATTER_BLOCKS,
        ]
    )

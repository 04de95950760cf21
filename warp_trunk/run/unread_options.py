"""The refusal of options that the chosen model does not read."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

from warp_trunk.case import Case
from warp_trunk.case.tissue_file import RIBS
from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError
from warp_trunk.meshing import MeshOptions

from .options import PAPERS, RunOptions, layers_from


@dataclass(frozen=True)
class RunChoices:
    """The choices that decide which options are read."""

    options: RunOptions
    """How the case is simulated."""
    layered: bool
    """Whether the tissue has layers, whose stiffness is relative to that of the first."""

    @property
    def springs(self) -> bool:
        """Whether the energy is itmsm."""
        return self.options.energy_of_tissue == "itmsm"

    @property
    def weighed(self) -> bool:
        """Whether a stiffness is weighed against another; with bones alone that move, only ratios count."""
        weight = self.layered or self.options.gravity or self.options.rigidity_of_skin
        return self.options.alpha is None and bool(weight)

    @property
    def mass_weighed(self) -> bool:
        """Whether mass is weighed against other mass, or against the skin, where alpha gives gravity."""
        return bool(self.options.alpha and (self.layered or self.options.rigidity_of_skin))


@dataclass(frozen=True)
class Reader:
    """Where an option is read, and what to add or leave out where it is not."""

    reads: Callable[[RunChoices], bool]
    """Whether a scene reads it."""
    add: tuple[str, str] = ("", "")
    """An option and its value that make it count."""
    without: str = ""
    """An option that, where it is given, stands in its way."""
    reported: Callable[[RunChoices], bool] = lambda scene: False
    """Whether a scene reports it, though it moves nothing there."""


def _springs(scene: RunChoices) -> bool:
    """Whether every symbol of eq. 4.6 is reported, also where only ratios count."""
    return scene.springs


_SPRINGS = Reader(_springs, ("energy", "itmsm"))
_RIBS = Reader(lambda scene: scene.options.bones == "follow", ("bones", "follow"))
_MESHED = Reader(lambda scene: scene.options.from_mesh is None, without="from_mesh")
_NEWTON = Reader(lambda scene: scene.options.simulation.relax.method == "newton", ("method", "newton"))
READERS: Mapping[str, Reader] = {
    **dict.fromkeys(("epsilon", "theta", "weights", "alpha"), _SPRINGS),
    "poisson_ratio": Reader(lambda scene: not scene.springs, ("energy", "neo-hookean")),
    "rest": Reader(lambda scene: bool(scene.options.acting_gravity), ("gravity", "9.81"), reported=_springs),
    "density": Reader(
        lambda scene: bool(scene.options.gravity or scene.mass_weighed), ("gravity", "9.81"), reported=_springs
    ),
    "gravity": Reader(lambda scene: scene.options.alpha is None, without="alpha"),
    "youngs_modulus": Reader(
        lambda scene: scene.weighed,
        ("gravity", "9.81"),
        without="alpha",
        reported=lambda scene: scene.springs and scene.options.alpha is None,
    ),
    **dict.fromkeys(("tolerance", "bands"), _NEWTON),
    **{field.name: _MESHED for field in fields(MeshOptions)},
    RIBS: _RIBS,
}
"""Options that not every scene reads, with those of [tissue] of case.toml, and its table [ribs]."""


def refuse_unread(options: RunOptions, case: Case | None = None) -> None:
    """Raise InputError for the first option or constant that is set and that the model does not read.

    Args:
        options: what is simulated; an option that has its default is not set.
        case: the patient; options that some case reads are read where it is left out.
    """
    scene = RunChoices(options, layered=case is None or layers_from(case, options) != "none")
    for name, called in (*_set_options(options), *(() if case is None else _set_constants(case))):
        reader = READERS.get(name)
        if reader is None or reader.reads(scene) or reader.reported(scene):
            continue
        if reader.without and getattr(options, reader.without) is not None:
            other = _flag(reader.without)
            raise InputError(f"{called}: is not used with {other}; leave one of them out")
        option, value = reader.add
        raise InputError(f"{called}: used by {_flag(option)} {value}; add it, or leave {called} out")


def _set_options(options: RunOptions) -> Iterator[tuple[str, str]]:
    """Each option that is set, by its name, and as the command line has it."""
    for name in options.constants:
        table, _, constant = name.rpartition(".")
        yield table if table == RIBS else constant, f"constant '{name}'" if table else _flag(name)
    for name in _changed(replace(options, constants={}, preset=frozenset()), RunOptions()):
        if name not in options.preset or getattr(options, name) != PAPERS[name]:
            yield name, _flag(name)


def _set_constants(case: Case) -> Iterator[tuple[str, str]]:
    """Each constant that a case sets, by its name, and as case.toml has it."""
    for name in _changed(case.tissue, Tissue()):
        yield name, f"[tissue] {name}"
    for name in _changed(case.rib_coupling, type(case.rib_coupling)()):
        yield RIBS, f"[{RIBS}] {name}"


def _changed(record: Any, default: Any) -> Iterator[str]:
    """Names of the fields, of nested records too, whose values differ."""
    for field in fields(record):
        value, usual = getattr(record, field.name), getattr(default, field.name)
        if is_dataclass(value):
            yield from _changed(value, usual)
        elif value != usual:
            yield field.name


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"

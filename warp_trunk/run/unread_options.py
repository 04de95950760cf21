"""The refusal of options that the chosen model does not read."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import TYPE_CHECKING, Any

from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError
from warp_trunk.meshing import MeshOptions

from .options import PAPERS, RunOptions

if TYPE_CHECKING:
    from warp_trunk.case import Case


@dataclass(frozen=True)
class Scene:
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

    reads: Callable[[Scene], bool]
    """Whether a scene reads it."""
    add: tuple[str, str] = ("", "")
    """An option and its value that make it count."""
    without: str = ""
    """An option that, where it is given, stands in its way."""
    reported: Callable[[Scene], bool] = lambda scene: False
    """Whether a scene reports it, though it moves nothing there."""


def _springs(scene: Scene) -> bool:
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
    "ribs": _RIBS,
}
"""Options that not every scene reads, with those of [tissue] of case.toml, and its table [ribs]."""


def refuse_unread(named: Mapping[str, str], options: RunOptions, *, layered: bool) -> None:
    """Raise InputError for the first given option that the model does not read.

    Args:
        named: what each given option is called where it was given, such as `--theta`, by its name.
        options: how the case is simulated.
        layered: whether its tissue has layers.
    """
    scene = Scene(options, layered)
    for name, called in named.items():
        reader = READERS.get(name)
        if reader is None or reader.reads(scene) or reader.reported(scene):
            continue
        if reader.without and getattr(options, reader.without) is not None:
            raise InputError(f"{called}: is not used with {_like(called, reader.without)}; leave one of them out")
        option, value = reader.add
        adding = f"{_like(called, option)} {value}"
        raise InputError(f"{called}: used by {adding}; add it, or leave {called} out")


def given_in(case: Case, options: RunOptions) -> dict[str, str]:
    """The names of options and of constants of a case that are not those by default, and what they are called.

    The papers' options stand together (`PAPERS`): the value that one has there was not given by itself.
    """
    differ = _changed(options, RunOptions())
    named = {name: name for name in differ if name not in PAPERS or getattr(options, name) != PAPERS[name]}
    named |= {name: f"[tissue] {name}" for name in _changed(case.tissue, Tissue())}
    for name in _changed(case.rib_coupling, type(case.rib_coupling)()):
        named["ribs"] = f"[ribs] {name}"
    return named


def _changed(record: Any, default: Any) -> Iterable[str]:
    """Names of the fields, of nested records too, whose values differ."""
    for one in fields(record):
        value, usual = getattr(record, one.name), getattr(default, one.name)
        if is_dataclass(value):
            yield from _changed(value, usual)
        elif value != usual:
            yield one.name


def _like(called: str, name: str) -> str:
    """An option named as another one is: with hyphens on the command line and for files, plainly in Python."""
    return name if called.isidentifier() else f"--{name.replace('_', '-')}"

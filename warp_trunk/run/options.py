"""`RunOptions` say what is simulated, `Execution` says how it is computed and kept."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from warp_trunk.case import Case
from warp_trunk.case.tissue_file import check_named
from warp_trunk.checking import check_fields
from warp_trunk.engine.energies.by_name import EnergyName, WeightsName
from warp_trunk.engine.parallel import MOST_THREADS
from warp_trunk.engine.physics import Physics
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.engine.tissue import (
    EARTH_GRAVITY,
    ENERGY,
    GRAVITY_LIMITS,
    RIGIDITY_LIMITS,
    SKIN_RIGIDITY,
    Limits,
)
from warp_trunk.errors import InputError
from warp_trunk.meshing import MeshOptions
from warp_trunk.meshing.layers import LayersFrom

PAPERS: dict[str, Any] = {
    "bones": "spline", "energy": "itmsm", "weights": "count", "rest": "scan", "skin_rigidity": 0.0,
}  # fmt: skip
"""The options that make the papers' model."""


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Physics and discretisation: everything that changes a number.

    >>> options = wt.RunOptions(gravity=9.81, bones="spline")
    >>> options.energy_of_tissue
    'itmsm'
    """

    mesh: MeshOptions = field(default_factory=MeshOptions)
    """How the trunk is meshed."""
    simulation: SimulationOptions = field(default_factory=SimulationOptions)
    """How the correction is applied."""
    energy: EnergyName | None = None
    """Energy of the tissue: neo-hookean (continuum) or itmsm (springs on edges, faces and volumes, the papers').
    By default the continuum with --bones follow, because rigid ribs crumple itmsm, and itmsm with the spline."""
    weights: WeightsName = "count"
    """Weight of an edge, face or tetrahedron in itmsm: count (each the same, the papers') or volume (the volume it
    represents, so that the stiffness does not depend on the size of tetrahedra)."""
    skin_rigidity: Annotated[float, RIGIDITY_LIMITS] | None = None
    """Flexural rigidity of the skin [N mm], 0 is off; by default 0.4 (2 mm of 0.42 MPa)
    with --bones follow, and off with the spline (the papers)."""
    precision: Literal["float32", "float64"] = "float32"
    """Precision of the simulation."""
    gravity: Annotated[float, GRAVITY_LIMITS] = 0.0
    """Gravity [m/s^2], pulling down; 0 is off."""
    alpha: Annotated[float, Limits(le=1e6)] | None = None
    """Gravity against stiffness in itmsm, 2 g M_0 H_0 / k_D (eq. 4.6 of the papers), in place of --gravity and
    --youngs-modulus; 0 is off."""
    rest: Literal["sag-free", "scan"] = "sag-free"
    """Rest state under gravity: sag-free, the shape that gravity pulls into the scan, so that nothing moves
    without surgery; or the scan itself, which then sags (the papers)."""
    layers: LayersFrom | None = None
    """Skin, fat and muscle: none (one tissue), by depth below the skin, or from the labels of a mesh; by default
    as in [layers] of case.toml."""
    bones: Literal["follow", "spline"] = "follow"
    """Motion of the bones. follow: each bone rigidly, known ones first, vertebrae by their landmarks, and ribs by
    the shares of [ribs]; spline: by the thin-plate spline through all landmarks, which bends them (the papers)."""
    bands: bool = False
    """Compute 95 % intervals from the errors that case.toml states in [uncertainty]; takes some seconds, longer
    under gravity."""
    from_mesh: Path | None = None
    """Simulate this mesh of the tissue (.vtu .vtk .xdmf .msh .inp, in mm and LPS) instead of making one; its outer
    boundary replaces the skin, and `--layers mesh` uses the labels of its cell data `tissue`."""

    constants: Mapping[str, float] = field(default_factory=dict)
    """Constants of tissue and ribs in place of those of the case, by their names in tissue.toml:
    `{"poisson_ratio": 0.4, "fat.youngs_modulus": 3.0, "ribs.reversible_part": 0.5}`."""

    preset: frozenset[str] = frozenset()
    """Options that `of_papers` or `--papers` set: one that the model does not read is passed over."""

    @classmethod
    def of_papers(cls) -> RunOptions:
        """The papers' options: one spline, eq. 4.6, weights by count, the scan at rest, no bending of the skin.

        >>> dataclasses.replace(wt.RunOptions.of_papers(), alpha=0.3).rest
        'scan'
        """
        return cls(**PAPERS, preset=frozenset(PAPERS))

    def __post_init__(self) -> None:
        """Raises InputError for a gravity that no place has, a skin that none has, or an unknown constant."""
        check_fields(self, "options")
        check_named(self.constants)

    @property
    def acting_gravity(self) -> float:
        """`gravity`, or the Earth's where alpha gives its weight [m/s^2]."""
        return EARTH_GRAVITY if self.alpha else self.gravity

    @property
    def rigidity_of_skin(self) -> float:
        """`skin_rigidity`, or what is taken where it is left out [N mm]."""
        if self.skin_rigidity is not None:
            return self.skin_rigidity
        return SKIN_RIGIDITY if self.bones == "follow" else 0.0

    @property
    def energy_of_tissue(self) -> EnergyName:
        """`energy`, or what is taken where it is left out; weights by volume are those of itmsm."""
        if self.energy is not None:
            return self.energy
        return ENERGY if self.bones == "follow" and self.weights == "count" else "itmsm"

    @property
    def physics(self) -> Physics:
        """The energy, the skin and gravity of these options."""
        return Physics(
            energy=self.energy_of_tissue,
            weights=self.weights,
            skin_rigidity=self.rigidity_of_skin,
            gravity=self.gravity,
            alpha=self.alpha,
        )


@dataclass(frozen=True, kw_only=True)
class Execution:
    """How a case is computed and kept; nothing of it changes what is simulated.

    >>> result = wt.simulate(case, options=small, execution=wt.Execution(threads=1, record=False))
    >>> result.recording is None
    True
    """

    device: str = "auto"
    """Where to compute: auto (a CUDA device if there is one), cpu, or cuda:0."""
    threads: Annotated[int, Limits(le=MOST_THREADS)] = 0
    """CPU threads; 0 is one for each core."""
    cache: bool = True
    """Keep the mesh on disk, and reuse it for the same surfaces and options."""
    record: bool = True
    """Write recording.rrd for the viewer."""
    view: bool = False
    """Show the recording in the viewer while it grows."""
    yes: bool = False
    """Simulate also where more memory is needed than this machine has."""

    def __post_init__(self) -> None:
        """Raises InputError for a field of another type, or a recording that is shown but not made."""
        check_fields(self, "execution")
        if self.view and not self.record:
            raise InputError("--view: shows what is recorded; leave --no-record out")


def layers_from(case: Case, options: RunOptions) -> LayersFrom:
    """Where the layers of a case come from."""
    if options.layers is not None:
        return options.layers
    return "none" if case.layers is None else "depth" if case.layers.mesh is None else "mesh"


def parameters(options: RunOptions) -> dict[str, Any]:
    """Every option by its own name, as on the command line; constants are those of the model's tissues."""
    flat = dataclasses.asdict(options)
    simulation, mesh = flat.pop("simulation"), flat.pop("mesh")
    flat = {**({} if options.from_mesh else mesh), **simulation.pop("relax"), **simulation, **flat}
    del flat["constants"], flat["preset"]
    flat |= {
        "energy": options.energy_of_tissue,
        "skin_rigidity": options.rigidity_of_skin,
        "gravity": options.acting_gravity,
        "from_mesh": None if options.from_mesh is None else str(options.from_mesh),
    }
    return flat

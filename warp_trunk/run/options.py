"""How a case is simulated, as asked for."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta

from warp_trunk.engine.energies.by_name import EnergyName, WeightsName
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.engine.tissue import EARTH_GRAVITY, ENERGY, SKIN_RIGIDITY
from warp_trunk.errors import InputError, nearest
from warp_trunk.io.records import check_fields
from warp_trunk.meshing import MeshOptions
from warp_trunk.meshing.layers import LayersFrom

MOST_RIGIDITY = 1000.0
"""That of 25 mm of skin [N mm]; a larger number is in another unit."""
PAPERS: dict[str, Any] = {
    "bones": "spline", "energy": "itmsm", "weights": "count", "rest": "scan", "skin_rigidity": 0.0,
}  # fmt: skip
"""The options that make the papers' model."""
MOST_ALPHA = 1e6
"""Far more than tissue that flows away."""
MOST_GRAVITY = 1000.0
"""A hundred times that of the Earth [m/s^2]."""


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """How a case is simulated.

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
    skin_rigidity: Annotated[float, Meta(ge=0.0, le=MOST_RIGIDITY, description="N mm")] | None = None
    """Flexural rigidity of the skin [N mm], 0 is off; by default 0.4 (2 mm of 0.42 MPa)
    with --bones follow, and off with the spline (the papers)."""
    device: str = "auto"
    """Where to compute: auto (a CUDA device if there is one), cpu, or cuda:0."""
    precision: Literal["float32", "float64"] = "float32"
    """Precision of the simulation."""
    threads: int = 0
    """CPU threads; 0 is one for each core."""
    gravity: Annotated[float, Meta(ge=0.0, le=MOST_GRAVITY, description="m/s^2, pulling down")] = 0.0
    """Gravity [m/s^2], pulling down; 0 is off."""
    alpha: Annotated[float, Meta(ge=0.0, le=MOST_ALPHA)] | None = None
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
    record: bool = True
    """Write recording.rrd for the viewer."""
    live: bool = False
    """Show the run live: `plan` opens the planning page in the browser, other commands the recording in the
    viewer."""
    from_mesh: Path | None = None
    """Simulate this mesh of the tissue (.vtu .vtk .xdmf .msh .inp, in mm and LPS) instead of making one; its outer
    boundary replaces the skin, and `--layers mesh` uses the labels of its cell data `tissue`."""

    yes: bool = False
    """Simulate also where more memory is needed than this machine has."""

    @classmethod
    def of_papers(cls, **changes: Any) -> RunOptions:
        """The papers' options: one spline, eq. 4.6, weights by count, the scan at rest, no bending of the skin.

        `changes` are single options by name, as in `simulate`.

        >>> wt.RunOptions.of_papers(alpha=0.3).rest
        'scan'
        """
        return with_changes(cls(**PAPERS), changes)

    def __post_init__(self) -> None:
        """Raises InputError for a gravity that no place has, or a skin that none has, before any work."""
        check_fields(self, "options")

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


def with_changes(options: RunOptions, changes: Mapping[str, Any]) -> RunOptions:
    """The options with single ones changed, each by its own name at whatever depth it stands: `tets=200_000`.

    Raises:
        InputError: there is no option of a name, or a value is not allowed.
    """
    left, known = dict(changes), set[str]()

    def changed(record: Any) -> Any:
        own: dict[str, Any] = {}
        for name, value in vars(record).items():
            known.add(name)
            if name in left:
                own[name] = left.pop(name)
            elif dataclasses.is_dataclass(value):
                own[name] = changed(value)
        return dataclasses.replace(record, **own)

    new = changed(options)
    for name in left:
        raise InputError(f"simulate: there is no option '{name}'{nearest(name, known)}")
    return new


def parameters(options: RunOptions) -> dict[str, Any]:
    """Every option by its own name, as on the command line."""
    nested = dataclasses.asdict(options)
    del nested["energy"], nested["skin_rigidity"]  # below, after the options that they depend on
    simulation = nested.pop("simulation")
    mesh = nested.pop("mesh") if options.from_mesh is None else {}
    relax = simulation.pop("relax")
    given = {} if options.from_mesh is None else {"from_mesh": str(options.from_mesh)}
    taken = {
        "energy": options.energy_of_tissue,
        "skin_rigidity": options.rigidity_of_skin,
        "gravity": options.acting_gravity,
    }
    return {**mesh, **simulation, **relax, **nested, **given, **taken}

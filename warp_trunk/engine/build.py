"""Making a model: the trunk at rest is checked, ordered, measured and uploaded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import warp as wp

from .checks import check_arguments, check_held, check_tissues
from .energies.by_name import ENERGIES, EnergyName, WeightsName
from .energies.itmsm import with_alpha
from .model import Model
from .ordering import order_nodes, order_tets, places
from .parallel import Parallel, takes_turns
from .rest_mesh import PRECISIONS, RestMesh
from .skin import make_skin
from .tissue import EARTH_GRAVITY, ENERGY, SKIN_RIGIDITY, Tissue
from .topology import Edges
from .trunk_mesh import TrunkMesh, check_trunk


@takes_turns
def build_model(
    trunk: TrunkMesh,
    tissue: Tissue | Sequence[Tissue] | None = None,
    *,
    energy: EnergyName = ENERGY,
    weights: WeightsName = "count",
    skin_rigidity: float = SKIN_RIGIDITY,
    gravity: float = 0.0,
    alpha: float | None = None,
    device: str | Parallel = "auto",
    precision: str = "float32",
    threads: int = 0,
) -> Model:
    """Measures the trunk at rest and uploads it.

    Args:
        trunk: the mesh before surgery.
        tissue: constants of the energy; the default tissue if left out. Of several, `trunk.tissue` says which
            a tetrahedron is made of, or which part of it.
        energy: 'neo-hookean', a continuum (stable neo-Hookean), or 'itmsm' (eq. 4.6 of [2]), the papers'.
        weights: how itmsm weights its features: by their 'count' (the papers) or by rest 'volume'.
        skin_rigidity: flexural rigidity of the skin [N mm]; 0 leaves its bending out, and costs nothing.
        gravity: acceleration [m/s^2]; 0 leaves the term out of the kernels.
        alpha: that of eq. 4.6, for itmsm alone, in place of `gravity`, which is then the Earth's, and of the
            Young's moduli: tissues get those that give it, in their proportion.
        device: 'auto', 'cpu' or 'cuda:N'; or where several models run, with its threads.
        precision: 'float32' or 'float64', of the device arrays; the host measures in float64.
        threads: CPU threads; 0 is all cores.

    Raises:
        InputError: an argument out of its range, a mesh whose parts do not fit together, a tetrahedron without
            volume at rest or of a tissue that is not given, or a piece of free tissue that no bone holds.
    """
    tissues = (tissue or Tissue(),) if isinstance(tissue, Tissue | None) else tuple(tissue)
    check_arguments(energy, weights, precision, skin_rigidity, gravity, alpha)
    parallel = device if isinstance(device, Parallel) else Parallel(device, threads)
    check_trunk(trunk, "trunk")
    check_held(trunk)
    check_tissues(trunk, tissues)
    order = order_nodes(trunk)
    corners = places(order)[trunk.tets]
    tet_order = order_tets(corners)
    rest = RestMesh(
        trunk.nodes[order],
        corners[tet_order],
        tissues,
        trunk.tissue[tet_order] if trunk.tissue is not None and len(tissues) > 1 else None,
        PRECISIONS[precision],
        parallel,
    )
    if alpha:
        gravity = EARTH_GRAVITY
        rest = with_alpha(rest, alpha, gravity)
    elements = ENERGIES[energy](rest, gravity, weights)
    skin = None
    if skin_rigidity:
        faces = places(order)[trunk.skin_nodes[trunk.skin_faces]]
        skin = make_skin(rest, faces, skin_rigidity, elements.per_millijoule(rest))
    edges = Edges.among(rest.corners if skin is None else np.vstack([rest.corners, skin.corners]))
    model = Model(
        parallel=parallel,
        scalar=rest.scalar,
        tissues=rest.tissues,
        gravity=gravity,
        order=order,
        tet_order=tet_order,
        free_nodes=int(np.count_nonzero(~trunk.prescribed)),
        rest=rest.nodes,
        corners=rest.corners,
        tets=rest.tets,
        elements=elements,
        edges=edges,
        in_precision=lambda precision: build_model(
            trunk,
            tissues,
            energy=energy,
            weights=weights,
            skin_rigidity=skin_rigidity,
            gravity=0.0 if alpha else gravity,
            alpha=alpha,
            device=parallel,
            precision=precision,
        ),
        released=lambda nodes: _released(model, nodes),
        label=rest.label,
        skin=skin,
    )
    return model


def _released(model: Model, nodes: np.ndarray) -> Model:
    """See `Model.released`; what was measured at rest serves on, as no tetrahedron gets another number."""
    stays = ~np.isin(model.order[model.prescribed], nodes)
    order = np.arange(model.nodes)
    order[model.prescribed] = model.free_nodes + np.argsort(stays, kind="stable")
    edges = model.edges.renumbered(places(order))
    corners, hinges = np.split(edges.stencils, [len(model.corners)])
    skin = model.skin
    if skin is not None:
        skin = replace(skin, corners=hinges, hinges=model.array(hinges, wp.vec4i))
    without = replace(
        model,
        order=model.order[order],
        free_nodes=model.nodes - int(np.count_nonzero(stays)),
        rest=model.rest[order],
        corners=corners,
        tets=model.array(corners, wp.vec4i),
        edges=edges,
        skin=skin,
        in_precision=lambda precision: _released(model.in_precision(precision), nodes),
        released=lambda more: _released(without, more),
    )
    return without

"""Making a model: the trunk at rest is checked, ordered, measured and uploaded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import warp as wp

from .checks import check_held, check_tissues
from .energies.by_name import ENERGIES
from .energies.itmsm import with_alpha
from .model import Model
from .ordering import order_nodes, order_tets, places
from .parallel import Parallel, takes_turns
from .physics import Physics, check_choice
from .rest_mesh import PRECISIONS, RestMesh
from .skin import make_skin
from .tissue import EARTH_GRAVITY, Tissue
from .topology import Edges
from .trunk_mesh import TrunkMesh, check_trunk


@takes_turns
def build_model(
    trunk: TrunkMesh,
    tissue: Tissue | Sequence[Tissue] | None = None,
    physics: Physics | None = None,
    *,
    device: str | Parallel = "auto",
    precision: str = "float32",
) -> Model:
    """Measures the trunk at rest and uploads it.

    Args:
        trunk: the mesh before surgery.
        tissue: constants of the energy; the default tissue if left out. Of several, `trunk.tissue` says which
            a tetrahedron is made of, or which part of it.
        physics: the energy, the skin and gravity; the default if left out.
        device: 'auto', 'cpu' (on all cores) or 'cuda:N'; or where several models run, with its threads.
        precision: 'float32' or 'float64', of the device arrays; the host measures in float64.

    Raises:
        InputError: an argument out of its range, a mesh whose parts do not fit together, a tetrahedron without
            volume at rest or of a tissue that is not given, or a piece of free tissue that no bone holds.
    """
    tissues = (tissue or Tissue(),) if isinstance(tissue, Tissue | None) else tuple(tissue)
    physics = physics or Physics()
    check_choice("precision", precision, PRECISIONS)
    parallel = device if isinstance(device, Parallel) else Parallel(device)
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
    gravity = physics.gravity
    if physics.alpha:
        gravity = EARTH_GRAVITY
        rest = with_alpha(rest, physics.alpha, gravity)
    elements = ENERGIES[physics.energy](rest, gravity, physics.weights)
    skin = None
    if physics.skin_rigidity:
        faces = places(order)[trunk.skin_nodes[trunk.skin_faces]]
        skin = make_skin(rest, faces, physics.skin_rigidity, elements.per_millijoule(rest))
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
        in_precision=lambda precision: build_model(trunk, tissues, physics, device=parallel, precision=precision),
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

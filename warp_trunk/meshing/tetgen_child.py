"""One run of TetGen, in a process of its own: what kills it does not take the program along.

Run as a script, `python tetgen_child.py IN.npz OUT.npz`; it imports nothing heavy, so that it starts fast, and no
main module again, so that scripts without a guard, notebooks and `python -c` can mesh.
"""

import sys

import numpy as np
import tetgen

from warp_trunk.system import DISK_FULL, end_with_parent


def main() -> None:
    """Reads surfaces, holes and bounds, and writes nodes and tetrahedra; a refusal goes to standard error."""
    end_with_parent()
    inputs = np.load(sys.argv[1], allow_pickle=False)
    mesher = tetgen.TetGen(inputs["vertices"], inputs["faces"])
    for point in inputs["holes"]:
        mesher.add_hole(point.tolist())
    bound = float(inputs["bound"])
    try:
        nodes, tets, *_ = mesher.tetrahedralize(
            plc=True,
            nobisect=True,  # no new nodes on the surfaces
            quality=True,
            minratio=float(inputs["ratio"]),
            mindihedral=0.0,
            optmaxdihedral=165.0,
            fixedvolume=bool(np.isfinite(bound)),
            maxvolume=bound if np.isfinite(bound) else -1.0,
            steinerleft=-1,
        )
    except RuntimeError as error:
        sys.exit(" ".join(str(error).split()))
    try:
        np.savez(sys.argv[2], nodes=nodes, tets=tets.astype(np.int32))
    except OSError:  # the disk is full
        sys.exit(DISK_FULL)


if __name__ == "__main__":
    main()

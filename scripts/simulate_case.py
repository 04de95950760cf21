"""Predict the trunk after surgery for a case folder: python scripts/simulate_case.py CASE RESULT"""

import sys

import warp_trunk as wt

case = wt.read_case(sys.argv[1])
trunk = wt.build_trunk(case.skin, case.bones, wt.MeshOptions(tets=225_000))
model = wt.build_model(trunk, case.tissue, device="auto")
bone_path = wt.spline_path(trunk.nodes, case.landmarks_before, case.landmarks_after)

increments = []
for increment in wt.simulate(model, bone_path, wt.SimulationOptions(increments=10)):
    print(f"{increment.load_factor:.0%}: {increment.relaxation.status.value}")
    increments.append(increment)

skin = wt.skin_after(case, trunk, increments[-1].displacement)
before, after = wt.measure(case.skin, case.landmarks_before), wt.measure(skin, case.landmarks_after, case.skin)
print(f"rotation of the back {before.max_thoracic_bsr:.1f} to {after.max_thoracic_bsr:.1f} degrees")
wt.write_result(sys.argv[2], case, trunk, model, increments)

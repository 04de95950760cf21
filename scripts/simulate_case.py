"""Predict the trunk after surgery for a case folder: python scripts/simulate_case.py CASE RESULT"""

import sys

from warp_trunk import (
    build_model,
    build_trunk,
    measure,
    predicted_skin,
    read_case,
    simulate,
    spline_path,
    write_result,
)

case = read_case(sys.argv[1])
trunk = build_trunk(case.skin, case.bones)
model = build_model(trunk, case.tissue)
bone_path = spline_path(trunk.nodes, case.landmarks_before, case.planned_landmarks)

increments = []
for increment in simulate(model, bone_path):
    print(f"{increment.load_factor:.0%}: {increment.relaxation.status.value}")
    increments.append(increment)

skin = predicted_skin(case, trunk, increments[-1].displacement)
before, after = measure(case.skin, case.landmarks_before), measure(skin, case.planned_landmarks, case.skin)
print(f"rotation of the back {before.max_thoracic_bsr:.1f} to {after.max_thoracic_bsr:.1f} degrees")
write_result(sys.argv[2], case, trunk, model, increments)

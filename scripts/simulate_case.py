"""Predict the trunk after surgery for a case folder: python scripts/simulate_case.py CASE RESULT"""

import sys

from warp_trunk import measure, read_case
from warp_trunk.engine.simulation import simulate
from warp_trunk.results import predicted_skin, write_result
from warp_trunk.run.prepare import prepare

case = read_case(sys.argv[1])
prepared = prepare(case)

increments = []
for increment in simulate(prepared.model, prepared.bone_path):
    print(f"{increment.load_factor:.0%}: {increment.relaxation.status.value}")
    increments.append(increment)

skin = predicted_skin(case, prepared.trunk, increments[-1].displacement)
before, after = measure(case.skin, case.landmarks_before), measure(skin, case.planned_landmarks, case.skin)
print(f"rotation of the back {before.max_thoracic_bsr:.1f} to {after.max_thoracic_bsr:.1f} degrees")
write_result(sys.argv[2], case, prepared.trunk, prepared.model, increments)

"""Predict the trunk after surgery for a case folder: python scripts/simulate_case.py CASE RESULT"""

import sys

import warp_trunk as wt

case = wt.read_case(sys.argv[1])
result = wt.simulate(case)
before, after = result.measures_before, result.measures
print(f"rotation of the back {before.max_thoracic_bsr:.1f} to {after.max_thoracic_bsr:.1f} degrees")
result.save(sys.argv[2])

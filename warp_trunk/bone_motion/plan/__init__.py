"""The surgeon's plan, and the rigid motion of every vertebra that meets it with the least motion.

May import what `bone_motion` may.
"""

from .plan_file import plan_in, plan_of_text, plan_text, read_plan, write_plan
from .planner import Planner, lenke_of, plan_surgery
from .record import CurvePlan, Plan, fused_levels, plan_words
from .surgery import CurveMotion, PlannedSurgery, VertebraMotion, fixed_numbers, planned_curves

__all__ = [
    "CurveMotion",
    "CurvePlan",
    "Plan",
    "PlannedSurgery",
    "Planner",
    "VertebraMotion",
    "fixed_numbers",
    "fused_levels",
    "lenke_of",
    "plan_in",
    "plan_of_text",
    "plan_surgery",
    "plan_text",
    "plan_words",
    "planned_curves",
    "read_plan",
    "write_plan",
]

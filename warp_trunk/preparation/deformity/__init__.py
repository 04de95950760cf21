"""The scoliotic curve of a spine, imposed on straight anatomy and corrected as by surgery.

May import `landmark_finder`, and what `preparation` may.
"""

from .deformity import correct, impose, make_case
from .spine_curve import MeasuredSpine, SpineCurve, read_measured_spine

__all__ = ["MeasuredSpine", "SpineCurve", "correct", "impose", "make_case", "read_measured_spine"]

"""The scoliotic curve of a spine, imposed on straight anatomy and corrected as by surgery."""

from .deformity import correct, impose, make_case
from .measured_spine import MeasuredSpine, read_measured_spine
from .spine_curve import SpineCurve

__all__ = ["MeasuredSpine", "SpineCurve", "correct", "impose", "make_case", "read_measured_spine"]

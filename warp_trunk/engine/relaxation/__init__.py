"""Relaxation of the soft tissue to the minimum of its energy with the bones held (eq. 4.3 of [2])."""

from .loop import Relaxer
from .outcome import Relaxation, RelaxOptions, RelaxStatus, RelaxStep

__all__ = ["RelaxOptions", "RelaxStatus", "RelaxStep", "Relaxation", "Relaxer"]

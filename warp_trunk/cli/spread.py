"""How commands say what a set of errors is like."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def mean_and_largest(errors: np.ndarray, names: Sequence[str] = (), unit: str = "mm") -> str:
    """Mean and largest of errors, shape (n,), and the name of the largest; NaN are passed over."""
    worst = f" ({names[int(np.nanargmax(errors))]})" if names else ""
    return f"mean {np.nanmean(errors):.2f}, largest {np.nanmax(errors):.2f} {unit}{worst}"

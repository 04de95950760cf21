"""From a scan of the back and a spine to a case: a body is fitted, and what was not measured is invented.

May import `phantom` and below, and what `preparation` may.
"""

from .fit import FittedBack, fit_back

__all__ = ["FittedBack", "fit_back"]

"""From the scans of digitizers to one closed skin."""

from .closing import close_skin

__all__ = ["close_skin"]

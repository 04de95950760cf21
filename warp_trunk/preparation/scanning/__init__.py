"""From the scans of digitizers to one closed skin. May import `phantom` and below, and what `preparation` may."""

from .closing import close_skin

__all__ = ["close_skin"]

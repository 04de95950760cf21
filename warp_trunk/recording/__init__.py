"""The Rerun recording of a simulation: what is drawn, and how the viewer lays it out."""

from .recording import Recording

__all__ = ["Recording"]

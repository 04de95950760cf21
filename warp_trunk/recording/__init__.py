"""The Rerun recording of a simulation: its scene, layout and viewer. May import `results` and below."""

from .recording import Recording
from .stream import load_rerun
from .viewer import start_viewer, view_result

__all__ = ["Recording", "load_rerun", "start_viewer", "view_result"]

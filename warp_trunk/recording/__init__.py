"""The Rerun recording of a simulation: what is drawn, how the viewer lays it out, and where it is shown."""

from .recording import Recording
from .stream import load_rerun
from .viewer import start_viewer, view_result

__all__ = ["Recording", "load_rerun", "start_viewer", "view_result"]

"""The public names and where they are defined; `__init__.py` reads this list."""

from .bone_motion.plan import CurvePlan, Plan, plan_surgery, read_plan, write_plan
from .case import Case, read_case, write_case
from .case.landmarks import Landmarks
from .case.motions import Motion, read_motions
from .engine.tissue import Tissue
from .errors import InputError
from .geometry.surface import Surface
from .io.surface_files import read_surface, write_surface
from .measures import compare_skins, measure, measure_back
from .preparation.back_scan import fit_back
from .preparation.deformity import SpineCurve, make_case
from .preparation.landmark_finder import find_landmarks
from .preparation.phantom import phantom_case
from .preparation.reconstruction import fit_atlas, register_skin
from .preparation.scanning import close_skin
from .recording import view_result
from .report.writing import write_report
from .results import Result, read_result
from .run.best_plan import best_plan
from .run.options import RunOptions
from .run.simulate import simulate

__version__: str
__all__ = [
    "Case",
    "CurvePlan",
    "InputError",
    "Landmarks",
    "Motion",
    "Plan",
    "Result",
    "RunOptions",
    "SpineCurve",
    "Surface",
    "Tissue",
    "best_plan",
    "close_skin",
    "compare_skins",
    "find_landmarks",
    "fit_atlas",
    "fit_back",
    "make_case",
    "measure",
    "measure_back",
    "phantom_case",
    "plan_surgery",
    "read_case",
    "read_motions",
    "read_plan",
    "read_result",
    "read_surface",
    "register_skin",
    "simulate",
    "view_result",
    "write_case",
    "write_plan",
    "write_report",
    "write_surface",
]

"""The public names and where they are defined; `__init__.py` reads this list."""

from .bone_motion.plan import CurvePlan, Plan, plan_surgery, read_plan, write_plan
from .bone_motion.plan.record import Bound
from .case import Case, read_case, write_case
from .case.axes import Axes
from .case.case import Study
from .case.landmarks import Landmarks, read_landmarks
from .case.layers import Layers
from .case.motions import Motion, read_motions
from .case.rib_coupling import RibCoupling
from .case.uncertainty import Uncertainty
from .engine.relaxation import RelaxOptions
from .engine.simulation import SimulationOptions
from .engine.tissue import Tissue
from .errors import InputError
from .geometry.cutting import CutPlane
from .geometry.surface import Surface
from .io.surface_files import read_surface, write_surface
from .measures import compare_skins, measure, measure_back
from .meshing import MeshOptions
from .preparation.back_scan import fit_back
from .preparation.back_scan.body import StraightBody
from .preparation.deformity import SpineCurve, make_case
from .preparation.deformity.patient_spine import PatientSpine
from .preparation.landmark_finder import find_landmarks
from .preparation.phantom import phantom_case
from .preparation.reconstruction import fit_atlas, register_skin
from .preparation.scanning import close_skin
from .preparation.scanning.closing import CloseOptions
from .recording import view_result
from .report.writing import write_report
from .results import Result, read_result
from .run.best_plan import best_plan
from .run.options import Execution, RunOptions
from .run.patient import PreparedPatient, patient_of
from .run.progress import Progress
from .run.simulate import simulate

__version__: str
__all__ = [
    "Axes",
    "Bound",
    "Case",
    "CloseOptions",
    "CurvePlan",
    "CutPlane",
    "Execution",
    "InputError",
    "Landmarks",
    "Layers",
    "MeshOptions",
    "Motion",
    "PatientSpine",
    "Plan",
    "PreparedPatient",
    "Progress",
    "RelaxOptions",
    "Result",
    "RibCoupling",
    "RunOptions",
    "SimulationOptions",
    "SpineCurve",
    "StraightBody",
    "Study",
    "Surface",
    "Tissue",
    "Uncertainty",
    "best_plan",
    "close_skin",
    "compare_skins",
    "find_landmarks",
    "fit_atlas",
    "fit_back",
    "make_case",
    "measure",
    "measure_back",
    "patient_of",
    "phantom_case",
    "plan_surgery",
    "read_case",
    "read_landmarks",
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

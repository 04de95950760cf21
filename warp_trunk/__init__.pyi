"""The public names and where they stand; `__init__.py` reads this list."""

from .bone_motion.articulation import bone_motions
from .bone_motion.bone_path import BonePath, rigid_path, spline_path
from .bone_motion.plan import CurvePlan, Plan, PlannedSurgery, Planner, plan_surgery, read_plan, write_plan
from .case import Case, read_case, write_case
from .case.landmarks import Landmarks, read_landmarks, write_landmarks
from .case.layers import Layers
from .case.motions import Motion, Turn, read_motions
from .engine.build import build_model
from .engine.model import Model
from .engine.newton import Relaxer
from .engine.relaxation import Relaxation, RelaxOptions, RelaxStatus
from .engine.sag_free import RestState, sag_free
from .engine.simulation import Increment, SimulationOptions, simulate
from .engine.tissue import Tissue
from .engine.trunk_mesh import TrunkMesh
from .errors import InputError
from .geometry.surface import Surface
from .io.surface_files import read_surface, write_surface
from .io.trunk_file import read_trunk, write_trunk
from .measures import (
    ApicalVertebra,
    BsrError,
    CobbAngle,
    DistanceStatistics,
    DualTangent,
    FlankAsymmetry,
    SacralLine,
    Shoulders,
    SkinComparison,
    SpineHeight,
    TrunkMeasures,
    TrunkShift,
    back_surface_rotation,
    cobb_angles,
    compare_skins,
    curves_after,
    measure,
    mirror_asymmetry,
    tissue_volume_change,
)
from .meshing import MeshOptions, build_trunk
from .meshing.joints import free_joints
from .meshing.layers import layered
from .preparation.deformity import SpineCurve, make_case
from .preparation.landmark_finder import FoundLandmarks, FoundVertebra, find_landmarks
from .preparation.phantom import TrunkSize, phantom_case
from .preparation.reconstruction import Film, fit_atlas, read_film, register_skin, triangulate
from .preparation.scanning import CloseOptions, CutPlane, align_parts, close_skin
from .recording import Recording
from .results import Result, Summary, predicted_skin, read_result, read_summary, write_result
from .run.options import RunOptions
from .run.patient import Patient, patient_of
from .run.prepare import Prepared, prepare
from .run.run_case import RunResult, run_case
from .run.run_plans import PlanResult, run_plans
from .run.sensitivities import Sensitivity, sensitivities

__all__ = [
    "ApicalVertebra",
    "BonePath",
    "BsrError",
    "Case",
    "CloseOptions",
    "CobbAngle",
    "CurvePlan",
    "CutPlane",
    "DistanceStatistics",
    "DualTangent",
    "Film",
    "FlankAsymmetry",
    "FoundLandmarks",
    "FoundVertebra",
    "Increment",
    "InputError",
    "Landmarks",
    "Layers",
    "MeshOptions",
    "Model",
    "Motion",
    "Patient",
    "Plan",
    "PlanResult",
    "PlannedSurgery",
    "Planner",
    "Prepared",
    "Recording",
    "RelaxOptions",
    "RelaxStatus",
    "Relaxation",
    "Relaxer",
    "RestState",
    "Result",
    "RunOptions",
    "RunResult",
    "SacralLine",
    "Sensitivity",
    "Shoulders",
    "SimulationOptions",
    "SkinComparison",
    "SpineCurve",
    "SpineHeight",
    "Summary",
    "Surface",
    "Tissue",
    "TrunkMeasures",
    "TrunkMesh",
    "TrunkShift",
    "TrunkSize",
    "Turn",
    "align_parts",
    "back_surface_rotation",
    "bone_motions",
    "build_model",
    "build_trunk",
    "close_skin",
    "cobb_angles",
    "compare_skins",
    "curves_after",
    "find_landmarks",
    "fit_atlas",
    "free_joints",
    "layered",
    "make_case",
    "measure",
    "mirror_asymmetry",
    "patient_of",
    "phantom_case",
    "plan_surgery",
    "predicted_skin",
    "prepare",
    "read_case",
    "read_film",
    "read_landmarks",
    "read_motions",
    "read_plan",
    "read_result",
    "read_summary",
    "read_surface",
    "read_trunk",
    "register_skin",
    "rigid_path",
    "run_case",
    "run_plans",
    "sag_free",
    "sensitivities",
    "simulate",
    "spline_path",
    "tissue_volume_change",
    "triangulate",
    "write_case",
    "write_landmarks",
    "write_plan",
    "write_result",
    "write_surface",
    "write_trunk",
]

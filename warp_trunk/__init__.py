"""Predicts how the trunk of a scoliosis patient looks after spine surgery.

A public name is imported from its module or room when it is first used, so that `import warp_trunk` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .bone_motion.articulation import bone_motions
    from .bone_motion.bone_path import BonePath, rigid_path, spline_path
    from .case import Case, read_case, write_case
    from .case.landmarks import Landmarks, read_landmarks, write_landmarks
    from .case.layers import Layers
    from .engine.model import Model, build_model
    from .engine.relaxation import Relaxation, Relaxer, RelaxOptions, RelaxStatus
    from .engine.sag_free import RestState, sag_free
    from .engine.simulation import Increment, SimulationOptions, simulate
    from .engine.tissue import Tissue
    from .engine.trunk_mesh import TrunkMesh, read_trunk, write_trunk
    from .errors import InputError
    from .geometry.surface import Surface
    from .io.surface_files import read_surface, write_surface
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
    from .preparation.phantom import TrunkSize, phantom_case
    from .preparation.reconstruction import Film, fit_atlas, read_film, register_skin, triangulate
    from .preparation.scanning import CloseOptions, CutPlane, align_parts, close_skin
    from .recording import Recording
    from .results import Result, predicted_skin, read_result, read_summary, write_result
    from .run.options import RunOptions
    from .run.prepare import Prepared, prepare
    from .run.run_case import RunResult, run_case

_MODULE = {
    "bone_motions": "bone_motion.articulation",
    "BonePath": "bone_motion.bone_path",
    "rigid_path": "bone_motion.bone_path",
    "spline_path": "bone_motion.bone_path",
    "Case": "case",
    "read_case": "case",
    "write_case": "case",
    "SpineCurve": "preparation.deformity",
    "make_case": "preparation.deformity",
    "InputError": "errors",
    "free_joints": "meshing.joints",
    "Landmarks": "case.landmarks",
    "read_landmarks": "case.landmarks",
    "write_landmarks": "case.landmarks",
    "Layers": "case.layers",
    "layered": "meshing.layers",
    "ApicalVertebra": "measures",
    "BsrError": "measures",
    "CobbAngle": "measures",
    "DistanceStatistics": "measures",
    "DualTangent": "measures",
    "FlankAsymmetry": "measures",
    "SacralLine": "measures",
    "Shoulders": "measures",
    "SkinComparison": "measures",
    "SpineHeight": "measures",
    "TrunkMeasures": "measures",
    "TrunkShift": "measures",
    "back_surface_rotation": "measures",
    "cobb_angles": "measures",
    "compare_skins": "measures",
    "curves_after": "measures",
    "measure": "measures",
    "mirror_asymmetry": "measures",
    "tissue_volume_change": "measures",
    "MeshOptions": "meshing",
    "build_trunk": "meshing",
    "Model": "engine.model",
    "build_model": "engine.model",
    "TrunkSize": "preparation.phantom",
    "phantom_case": "preparation.phantom",
    "Film": "preparation.reconstruction",
    "fit_atlas": "preparation.reconstruction",
    "read_film": "preparation.reconstruction",
    "register_skin": "preparation.reconstruction",
    "triangulate": "preparation.reconstruction",
    "Recording": "recording",
    "Relaxation": "engine.relaxation",
    "Relaxer": "engine.relaxation",
    "RelaxOptions": "engine.relaxation",
    "RelaxStatus": "engine.relaxation",
    "RestState": "engine.sag_free",
    "sag_free": "engine.sag_free",
    "Result": "results",
    "read_result": "results",
    "read_summary": "results",
    "predicted_skin": "results",
    "write_result": "results",
    "Prepared": "run.prepare",
    "prepare": "run.prepare",
    "RunResult": "run.run_case",
    "run_case": "run.run_case",
    "RunOptions": "run.options",
    "CloseOptions": "preparation.scanning",
    "CutPlane": "preparation.scanning",
    "align_parts": "preparation.scanning",
    "close_skin": "preparation.scanning",
    "Increment": "engine.simulation",
    "SimulationOptions": "engine.simulation",
    "simulate": "engine.simulation",
    "Surface": "geometry.surface",
    "read_surface": "io.surface_files",
    "write_surface": "io.surface_files",
    "Tissue": "engine.tissue",
    "TrunkMesh": "engine.trunk_mesh",
    "read_trunk": "engine.trunk_mesh",
    "write_trunk": "engine.trunk_mesh",
}

__all__ = [
    "ApicalVertebra",
    "BonePath",
    "BsrError",
    "Case",
    "CloseOptions",
    "CobbAngle",
    "CutPlane",
    "DistanceStatistics",
    "DualTangent",
    "Film",
    "FlankAsymmetry",
    "Increment",
    "InputError",
    "Landmarks",
    "Layers",
    "MeshOptions",
    "Model",
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
    "Shoulders",
    "SimulationOptions",
    "SkinComparison",
    "SpineCurve",
    "SpineHeight",
    "Surface",
    "Tissue",
    "TrunkMeasures",
    "TrunkMesh",
    "TrunkShift",
    "TrunkSize",
    "align_parts",
    "back_surface_rotation",
    "bone_motions",
    "build_model",
    "build_trunk",
    "close_skin",
    "cobb_angles",
    "compare_skins",
    "curves_after",
    "fit_atlas",
    "free_joints",
    "layered",
    "make_case",
    "measure",
    "mirror_asymmetry",
    "phantom_case",
    "predicted_skin",
    "prepare",
    "read_case",
    "read_film",
    "read_landmarks",
    "read_result",
    "read_summary",
    "read_surface",
    "read_trunk",
    "register_skin",
    "rigid_path",
    "run_case",
    "sag_free",
    "simulate",
    "spline_path",
    "tissue_volume_change",
    "triangulate",
    "write_case",
    "write_landmarks",
    "write_result",
    "write_surface",
    "write_trunk",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE:
        raise AttributeError(f"module 'warp_trunk' has no attribute '{name}'")
    value = getattr(import_module(f".{_MODULE[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

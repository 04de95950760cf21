"""Predicts how the trunk of a scoliosis patient looks after spine surgery.

A public name is imported from its module or room when it is first used, so that `import warp_trunk` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .articulation import bone_motions
    from .bone_path import BonePath, rigid_path, spline_path
    from .case import Case, read_case, write_case
    from .deformity import SpineCurve, make_case
    from .errors import InputError
    from .joints import free_joints
    from .landmarks import Landmarks, read_landmarks, write_landmarks
    from .layers import Layers, layered
    from .measures import (
        BsrError,
        CobbAngle,
        DistanceStatistics,
        DualTangent,
        FlankAsymmetry,
        SacralLine,
        SkinComparison,
        TrunkMeasures,
        TrunkShift,
        back_surface_rotation,
        cobb_angles,
        compare_skins,
        measure,
        mirror_asymmetry,
        tissue_volume_change,
    )
    from .meshing import MeshOptions, build_trunk
    from .model import Model, build_model
    from .phantom import TrunkSize, phantom_case
    from .reconstruction import Film, fit_atlas, read_film, register_skin, triangulate
    from .recording import Recording
    from .relaxation import Relaxation, Relaxer, RelaxOptions, RelaxStatus
    from .rest import RestState, sag_free
    from .results import Result, read_result, read_summary, skin_after, write_result
    from .run import RunResult, run_case
    from .run_options import RunOptions
    from .scanning import CloseOptions, CutPlane, align_parts, close_skin
    from .simulation import Increment, SimulationOptions, simulate
    from .surface import Surface, read_surface, write_surface
    from .tissue import Tissue
    from .trunk_mesh import TrunkMesh, read_trunk, write_trunk

_MODULE = {
    "bone_motions": "articulation",
    "BonePath": "bone_path",
    "rigid_path": "bone_path",
    "spline_path": "bone_path",
    "Case": "case",
    "read_case": "case",
    "write_case": "case",
    "SpineCurve": "deformity",
    "make_case": "deformity",
    "InputError": "errors",
    "free_joints": "joints",
    "Landmarks": "landmarks",
    "read_landmarks": "landmarks",
    "write_landmarks": "landmarks",
    "Layers": "layers",
    "layered": "layers",
    "BsrError": "measures",
    "CobbAngle": "measures",
    "DistanceStatistics": "measures",
    "DualTangent": "measures",
    "FlankAsymmetry": "measures",
    "SacralLine": "measures",
    "SkinComparison": "measures",
    "TrunkMeasures": "measures",
    "TrunkShift": "measures",
    "back_surface_rotation": "measures",
    "cobb_angles": "measures",
    "compare_skins": "measures",
    "measure": "measures",
    "mirror_asymmetry": "measures",
    "tissue_volume_change": "measures",
    "MeshOptions": "meshing",
    "build_trunk": "meshing",
    "Model": "model",
    "build_model": "model",
    "TrunkSize": "phantom",
    "phantom_case": "phantom",
    "Film": "reconstruction",
    "fit_atlas": "reconstruction",
    "read_film": "reconstruction",
    "register_skin": "reconstruction",
    "triangulate": "reconstruction",
    "Recording": "recording",
    "Relaxation": "relaxation",
    "Relaxer": "relaxation",
    "RelaxOptions": "relaxation",
    "RelaxStatus": "relaxation",
    "RestState": "rest",
    "sag_free": "rest",
    "Result": "results",
    "read_result": "results",
    "read_summary": "results",
    "skin_after": "results",
    "write_result": "results",
    "RunResult": "run",
    "run_case": "run",
    "RunOptions": "run_options",
    "CloseOptions": "scanning",
    "CutPlane": "scanning",
    "align_parts": "scanning",
    "close_skin": "scanning",
    "Increment": "simulation",
    "SimulationOptions": "simulation",
    "simulate": "simulation",
    "Surface": "surface",
    "read_surface": "surface",
    "write_surface": "surface",
    "Tissue": "tissue",
    "TrunkMesh": "trunk_mesh",
    "read_trunk": "trunk_mesh",
    "write_trunk": "trunk_mesh",
}

__all__ = [
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
    "SimulationOptions",
    "SkinComparison",
    "SpineCurve",
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
    "fit_atlas",
    "free_joints",
    "layered",
    "make_case",
    "measure",
    "mirror_asymmetry",
    "phantom_case",
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
    "skin_after",
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

"""Named points on bones, and the files of spreadsheets and of 3D Slicer that hold them."""

from ..anatomy import VERTEBRAE
from .files import COLUMNS, landmark_file, read_landmarks, write_landmarks
from .landmarks import ASIS, NO_LANDMARKS, VERTEBRA_POINTS, Landmarks, bone_of

__all__ = [
    "ASIS",
    "COLUMNS",
    "NO_LANDMARKS",
    "VERTEBRAE",
    "VERTEBRA_POINTS",
    "Landmarks",
    "bone_of",
    "landmark_file",
    "read_landmarks",
    "write_landmarks",
]

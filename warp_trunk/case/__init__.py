"""A patient's skin, bones and landmarks, read, checked and written as a case folder. May import `io` and below."""

from .axes import Axes
from .case import Case
from .case_folder import read_case, read_checked_case, write_case
from .checks import check_case

__all__ = ["Axes", "Case", "check_case", "read_case", "read_checked_case", "write_case"]

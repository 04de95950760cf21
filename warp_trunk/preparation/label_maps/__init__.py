"""From a label map of a CT or MRI, or surfaces with names of others, to a case.

May import `phantom` and below, and what `preparation` may.
"""

from .import_case import Imported, ImportOptions, import_case
from .sources import read_source

__all__ = ["ImportOptions", "Imported", "import_case", "read_source"]

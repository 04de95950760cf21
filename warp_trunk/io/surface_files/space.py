"""The patient axes that a file states for itself: 3D Slicer writes SPACE=RAS or SPACE=LPS into its header."""

from __future__ import annotations

import re

from ..file_access import FormatError
from .vtk import xml_text

_WORD = r"(?<![A-Z_])(?:SPACE|COORDINATE[ _]?SYSTEM)\s*[=:]\s*([A-Z-]+)"
_FIELD = rb"\nSPACE 1 1 string\r?\n[\x80-\xff]?([A-Za-z-]+)"
"""A string of VTK's field data: a line of text, or in a binary file its length and the letters."""
_NAMES = {"LEFT-POSTERIOR-SUPERIOR": "LPS", "RIGHT-ANTERIOR-SUPERIOR": "RAS"}
_HEAD = 100_000
"""Comments that far from the beginning are read [bytes]."""


def stated_space(ending: str, content: bytes) -> str | None:
    """LPS or RAS where the header of a surface or a mesh states it; None where it does not.

    It stands in a comment of PLY, OBJ, OFF, INP, MSH and XML, in the title of STL and of VTK's legacy format, and
    in the field data SPACE of VTK's formats.

    Raises:
        FormatError: it states other axes, or two different ones.
    """
    words = re.findall(_WORD, _header(ending, content).decode("latin-1").upper())
    if ending == ".vtk":
        words += [name.decode("ascii").upper() for name in re.findall(_FIELD, content)]
    elif ending in (".vtp", ".vtu") and b'"SPACE"' in content:
        words += [text.strip().upper() for text in xml_text(content, "SPACE")]
    spaces = {str(_NAMES.get(name, name)) for name in words}
    if spaces - {"LPS", "RAS"} or len(spaces) > 1:
        raise FormatError(f"its header says SPACE={' and '.join(sorted(spaces))}, and LPS or RAS was expected")
    return spaces.pop() if spaces else None


def _header(ending: str, content: bytes) -> bytes:
    """The part of a file that people write into."""
    start = content[:_HEAD]
    if ending == ".ply":
        return b"\n".join(re.findall(rb"(?m)^(?:comment|obj_info)\b.*", start.partition(b"end_header")[0]))
    if ending == ".stl":
        return start[:80] if not start.lstrip().startswith(b"solid") else start.lstrip().partition(b"\n")[0][:200]
    if ending == ".vtk":
        return b"".join(start.split(b"\n", 2)[1:2])
    if ending in (".obj", ".off", ".inp"):
        return b"\n".join(re.findall(rb"(?m)^\s*(?:#|\*\*).*", start))
    if ending in (".xdmf", ".feb"):
        return b"\n".join(re.findall(rb"(?s)<!--.*?-->", start))
    if ending == ".msh":
        return b"\n".join(re.findall(rb"(?s)\$Comments\r?\n(.*?)\$EndComments", content))
    return b""


_CODES = '<DataArray type="UInt8" Name="SPACE" NumberOfTuples="3" format="ascii">{}</DataArray>'
"""The codes of the letters: meshio 5.3 refuses a file with an array of strings."""
_NEW = {
    # ending: what it is written before or after, and the text
    ".obj": (b"", "# SPACE={}\n"),
    ".inp": (b"", "** SPACE={}\n"),
    ".off": (b"\n", "# SPACE={}\n"),
    ".xdmf": (b">", "<!-- SPACE={} -->"),
    ".feb": (b"?>", "<!-- SPACE={} -->"),
    ".vtk": (b"# vtk DataFile Version 5.1\n", "SPACE={} "),
    ".vtu": (b"<FieldData>", _CODES),
    ".msh": (None, "$Comments\nSPACE={}\n$EndComments\n"),
}
"""By the ending: the first place after which the axes are stated, or None for the end of the file; and how."""


def with_space(ending: str, content: bytes, space: str) -> bytes:
    """A file that this program has written with its axes stated where others look for them."""
    if ending == ".stl":  # its title has 80 bytes
        return f"warp_trunk SPACE={space}".encode().ljust(80) + content[80:]
    if ending not in _NEW:  # GLB has axes of its own
        return content
    place, text = _NEW[ending]
    stated = text.format(" ".join(map(str, space.encode())) if ending == ".vtu" else space).encode("latin-1")
    at = len(content) if place is None else content.index(place) + len(place)
    return content[:at] + stated + content[at:]

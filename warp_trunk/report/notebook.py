"""A result as a notebook shows it."""

from __future__ import annotations

import base64
import html
from typing import TYPE_CHECKING

from .relief import relief, window
from .skin_pictures import back_picture
from .style import RC, file_of
from .writing import poses_of

if TYPE_CHECKING:
    from warp_trunk.results import Result


def notebook_html(result: Result) -> str:
    """How the simulation ended, and the back before surgery and as predicted; only the words without a spine."""
    from matplotlib import rc_context  # heavy

    words = f"<p><b>{html.escape(result.summary.case)}</b>: {result.status.name}, {result.status.value}</p>"
    if not result.landmarks_before.names:
        return words
    poses = poses_of(result)
    seen = window([(pose.skin, pose.landmarks) for pose in poses])
    with rc_context(RC):
        reliefs = [relief(pose.skin, pose.landmarks, seen) for pose in poses]
        picture = base64.b64encode(file_of(back_picture(poses, reliefs, seen), "png")).decode()
    return f'{words}<img src="data:image/png;base64,{picture}" alt="The back before and after" width="800">'

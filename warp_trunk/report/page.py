"""The report as one HTML file, which needs nothing else and reaches for nothing."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import TYPE_CHECKING

from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.measures.comparison import DETECTABLE

from .modelled import modelled, not_modelled
from .sentences import sentences
from .tables import error_rows, head, measure_rows, rotation_rows

if TYPE_CHECKING:
    from warp_trunk.measures import SkinComparison
    from warp_trunk.results import Summary

    from .style import Pose


def page(
    poses: Sequence[Pose],
    comparison: SkinComparison | None,
    summary: Summary,
    drawings: Mapping[str, bytes],
) -> str:
    """The text of the page; all that comes from files is escaped.

    Args:
        poses: before surgery, predicted, and the actual one where it is known.
        comparison: of the predicted skin with the actual one, where that is known.
        summary: the summary of the result.
        drawings: by name the pictures that the page shows, as SVG.
    """
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    text = files("warp_trunk.report").joinpath("page.html").read_text(encoding="utf-8")
    status = summary.ending
    return environment.from_string(text).render(
        case=summary.case,
        converged=status is RelaxStatus.CONVERGED,
        status=status.name,
        reason=status.value[:1].upper() + status.value[1:],
        poses=len(poses),
        titles=", ".join(pose.look.title for pose in poses),
        pictures={name: b64encode(drawing).decode() for name, drawing in drawings.items()},
        sentences=sentences(poses, comparison),
        measure_head=head(poses, "measure"),
        measure_rows=measure_rows(poses),
        rotation_head=head(poses, "vertebra"),
        rotation_rows=rotation_rows(poses),
        error_rows=error_rows(comparison) if comparison else [],
        detectable=DETECTABLE,
        modelled=modelled(summary),
        not_modelled=not_modelled(summary),
        options=[(name, _text(value)) for name, value in summary.parameters.items()],
        versions=[(name, _text(value)) for name, value in summary.versions.items()],
        seconds=[(name, "–" if value is None else f"{value:.1f}") for name, value in summary.seconds.items()],
    )


def _text(value: object) -> str:
    if value is None:
        return "not known"
    return ("no", "yes")[value] if isinstance(value, bool) else str(value)

"""The report as one HTML file, which needs nothing else and reaches for nothing."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.simulation import ON_THE_WAY
from warp_trunk.measures import SkinComparison
from warp_trunk.measures.comparison import DETECTABLE
from warp_trunk.measures.part import Agreement, agreement_rows
from warp_trunk.measures.skin_quality import LOOK, STRETCH
from warp_trunk.measures.table import as_html

from . import tables
from .modelled import modelled, not_modelled, option_rows, value_text
from .sentences import glance, sentences
from .style import Pose

if TYPE_CHECKING:
    from warp_trunk.results import Summary


_OPTIONAL = ("error", "shoulders", "sure", "hump", "trends")
"""Pictures that a page may be without."""


def page(
    poses: Sequence[Pose],
    comparison: SkinComparison | None,
    summary: Summary,
    drawings: Mapping[str, bytes],
    plan: str | None = None,
) -> str:
    """The text of the page; all that comes from files is escaped.

    Args:
        poses: before surgery, predicted, and the actual one where it is known.
        comparison: of the predicted skin with the actual one, where that is known.
        summary: the summary of the result.
        drawings: by name the pictures that the page shows, as SVG.
        plan: the text of the plan that made the case, where one did.
    """
    quality = summary.skin_quality
    return rendered(
        "page.html",
        drawings,
        quality=quality,
        hatched=quality is not None and bool(quality.faults),
        stretch=f"{LOOK:g}",
        implausible=f"{STRETCH:g}",
        glance=glance(poses),
        sentences=sentences(poses, comparison, summary.bands),
        measure_head=tables.head(poses, "measure"),
        measure_rows=tables.measure_table(poses),
        rotation_head=tables.head(poses, "level"),
        rotation_rows=tables.rotation_table(poses),
        bands=summary.bands,
        band_head=tables.BAND_HEAD,
        band_rows=tables.band_table(poses, summary.bands) if summary.bands else [],
        source_head=tables.SOURCE_HEAD,
        source_rows=tables.source_table(summary.bands) if summary.bands else [],
        error_rows=tables.error_table(comparison) if comparison else [],
        detectable=DETECTABLE,
        **_of_run(poses, summary, plan),
    )


def part_page(
    poses: Sequence[Pose],
    summary: Summary,
    drawings: Mapping[str, bytes],
    agreed: Agreement | None,
    plan: str | None,
) -> str:
    """The text of the page of a part of the body without a spine; the arguments are those of `page`, and how far
    the prediction is from the actual skin where that is known."""
    return rendered(
        "part.html",
        drawings,
        change_rows=[*tables.change_table(poses), *tables.profile_table(summary.points)],
        error_rows=[] if agreed is None else agreement_rows(agreed),
        **_of_run(poses, summary, plan),
    )


def _of_run(poses: Sequence[Pose], summary: Summary, plan: str | None) -> dict[str, Any]:
    """The data of the run on every page."""
    status = summary.ending
    return {
        "case": summary.case,
        "plan": plan,
        "warnings": summary.warnings,
        "point_rows": tables.point_table(summary.points),
        "ratio_rows": tables.ratio_table(summary.points),
        "chest_rows": [[name, f"{was:.1f}", f"{will:.1f}"] for name, (was, will) in summary.chest.items()],
        "virtual": summary.virtual,
        "converged": status is RelaxStatus.CONVERGED,
        "status": status.name,
        "reason": status.value[:1].upper() + status.value[1:],
        "poses": len(poses),
        "many": "many" if len(poses) > 2 else "",
        "titles": ", ".join(pose.look.title for pose in poses),
        "increments": len(summary.increments),
        "reached": _reached(summary),
        "modelled": modelled(summary),
        "not_modelled": not_modelled(summary),
        "options": option_rows(summary.parameters),
        "versions": [(name, value_text(value)) for name, value in summary.versions.items()],
        "seconds": [(name, "–" if value is None else f"{value:.1f}") for name, value in summary.seconds.items()],
    }


def rendered(template: str, drawings: Mapping[str, bytes], **values: Any) -> str:
    """A page from its template, with pictures as `pictures` (None for those that are not drawn) and the style."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=PackageLoader("warp_trunk", "report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["table"] = lambda *cells: Markup(as_html(*cells))
    style = files("warp_trunk.report").joinpath("style.css").read_text(encoding="utf-8")
    pictures = dict.fromkeys(_OPTIONAL) | {name: b64encode(drawing).decode() for name, drawing in drawings.items()}
    return environment.get_template(template).render(style=style, pictures=pictures, **values).lstrip()


def _reached(summary: Summary) -> str:
    """Distance from the equilibrium of the last two relaxations, in words; empty if it is not known."""
    tolerance = summary.parameters.get("tolerance")
    errors = [increment.estimated_error_mm for increment in summary.increments[-2:]]
    if tolerance is None or len(errors) < 2 or errors[0] is None or errors[1] is None:
        return ""
    return (
        f"the one before it may stop at {ON_THE_WAY * tolerance:g} mm (it stopped at {errors[0]:.2g}) "
        f"and the last one at {tolerance:g} mm (it reached {errors[1]:.2g})"
    )

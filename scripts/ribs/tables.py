"""The tables of docs/ribs.md."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from benchmarking.tables import markdown

from .rows import LEVELS, Row, Shoulders, Smoothness, apex_of, rotations, shoulders, smoothness
from .study import CORRECTIONS, PATIENTS, SHOWN, WAYS, Study, name_of

ABOVE = slice(0, LEVELS.index("T3"))
BELOW = slice(LEVELS.index("L3"), len(LEVELS))
TOLD = ("T1", "T3", "T5", "T8", "T10", "T12", "L1", "L2", "L3")
"""Levels at which shares are compared."""


def by_patient(rows: Sequence[Row]) -> str:
    """A line for each patient and way."""
    lines = []
    for patient, way in dict.fromkeys((row.patient, row.way) for row in rows):
        all_ = [row for row in rows if (row.patient, row.way) == (patient, way)]
        row = next((row for row in all_ if row.correction == SHOWN), all_[0])
        change = row.change
        ratios = {one.correction: f"{one.over_cobb:.2f}" for one in all_}
        lines.append(
            [
                patient,
                way if row.correction == SHOWN else f"{way}, at {row.correction:g}",
                f"{LEVELS[row.apex]}, {abs(row.before[row.apex]):.1f}",
                ", ".join(ratios.get(correction, "-") for correction in CORRECTIONS),
                f"{abs(change[row.apex]) / row.derotation:.2f}",
                "-" if row.less is None else f"{row.of_less:.1f}",
                f"{change[0]:+z.1f} ({row.along[0]:+z.1f})",
                "; ".join(f"{change[LEVELS.index(level)]:+z.1f}" for level in ("L2", "L3")),
                _heights(row.shoulders_before, row.shoulders_after),
                *_skin(row.smooth),
                str(row.iterations),
                str(row.inverted),
                row.status,
            ]
        )
    over = f"change of BSR over that of Cobb at {', '.join(f'{correction:g}' for correction in CORRECTIONS)}"
    names = [
        "curve",
        "way",
        "apex, BSR before",
        over,
        "for each degree of derotation",
        "5 degrees less derotation",
    ]
    names += [f"T1 at {SHOWN:g} (along the shoulders)", f"L2; L3 at {SHOWN:g}", "right shoulder higher [mm]"]
    return markdown([*names, f"skin edges at {SHOWN:g}", "fold", "iterations", "inverted", "ends"], lines)


def by_bar(rows: Sequence[Row]) -> str:
    """How each bar is met by all plans of each way."""
    own = {way: [row for row in rows if row.way == way] for way in WAYS}
    cells = {way: _bars(all_) for way, all_ in own.items() if all_}
    names = next(iter(cells.values()))
    return markdown(["bar", *cells], [[name, *(told[name] for told in cells.values())] for name in names])


def imposed(study: Study) -> str:
    """The skin on which corrected curves are imposed, against the skin before: no tissue is simulated."""
    lines = []
    for curve in PATIENTS:
        case = study.plan(curve, SHOWN, "spline")
        skin = study.imposed(curve.corrected(SHOWN))[0]
        before = rotations(case.skin, case.landmarks_before)
        change = np.subtract(rotations(skin, case.planned_landmarks), before)
        was, now = shoulders(case.skin, case.landmarks_before), shoulders(skin, case.planned_landmarks)
        told = [f"{change[at]:+z.1f}" for at in (apex_of(before), LEVELS.index("L2"), LEVELS.index("L3"))]
        upper = f"{change[0]:+z.1f} ({now.rotations[0] - was.rotations[0]:+z.1f})"
        edges, fold = _skin(smoothness(case.skin, skin))
        lines.append([name_of(curve), edges, fold, upper, *told, _heights(was, now)])
    names = ["BSR at T1 (along the shoulders)", "at the apex of BSR", "at L2", "at L3"]
    return markdown(["curve", "edges", "fold", *names, "right shoulder higher [mm]"], lines)


def by_truth(rows: Sequence[Row]) -> str:
    """How far each way's skin lies from that on which the corrected curve is imposed."""
    shown = [row for row in rows if row.correction == SHOWN]
    lines = []
    for patient in dict.fromkeys(row.patient for row in shown):
        own = {row.way: row for row in shown if row.patient == patient}
        ends = [next(iter(own.values())).truth_before, *(own[way].truth_after for way in WAYS if way in own)]
        lines.append([patient, *(f"{end.mean:.1f}; {end.most:.0f}" for end in ends)])
    ways = [way for way in WAYS if way in {row.way for row in shown}]
    return markdown(["curve", "before", *ways], lines)


def by_share(rows: Mapping[str, Row], usual: Row) -> str:
    """What other shares change, by level [degrees]; `rows` by what is other in them."""
    at = [LEVELS.index(level) for level in TOLD]
    lines = [
        [what, *(f"{value:+z.1f}" for value in np.subtract(row.after, usual.after)[at])]
        for what, row in rows.items()
    ]
    return markdown(["what", *TOLD], lines)


def _skin(smooth: Smoothness) -> tuple[str, str]:
    (least, most), (low, high) = smooth.edges, smooth.most_edges
    return (
        f"{least:.2f} to {most:.2f} ({low:.2f} to {high:.2f})",
        f"{smooth.fold:.0f} ({smooth.most_fold:.0f})",
    )


def _heights(before: Shoulders, after: Shoulders) -> str:
    return f"{before.higher:z.0f} to {after.higher:z.0f}"


def _bars(rows: Sequence[Row]) -> dict[str, str]:
    shown = [row for row in rows if row.correction == SHOWN] or rows
    ratios = np.array([row.over_cobb for row in rows])
    slopes = [abs(row.change[row.apex]) / row.derotation for row in rows]
    less = [row.of_less for row in rows if row.less is not None]
    left = [
        _span(np.abs(row.after[LEVELS.index("T7") : LEVELS.index("T10") + 1]).tolist(), 1)
        for row in shown
        if row.patient == "thoracic 60"
    ]
    return {
        "change of the hump over that of Cobb 0.58 ± 0.08": f"{_span(ratios.tolist(), 2)}, "
        f"{int((np.abs(ratios - 0.58) <= 0.08).sum())} of {len(rows)} plans within",
        "5 degrees less of derotation change BSR by at most 1.5": _span(less, 1) if less else "-",
        "BSR for each degree of derotation 0.3 to 0.6": _span(slopes, 2),
        f"residual BSR 4 to 12 degrees, T7 to T10 (60 degrees, {SHOWN:g})": "; ".join(left) or "-",
        "no level above T3 changes by more than the apex": _count([row.quiet(ABOVE) for row in rows]),
        "the same where T1 and T2 are cut along the shoulders": _count([row.quiet_along for row in rows]),
        "no level below L2 changes by more than the apex": _count([row.quiet(BELOW) for row in rows]),
        "edges of skin 0.85 to 1.2, folds to 10 degrees": _worst([row.smooth for row in rows]),
        "plans with inverted tetrahedra, the most of them": f"{sum(row.inverted > 0 for row in rows)} of "
        f"{len(rows)}, {max(row.inverted for row in rows)}",
        f"linear iterations at {SHOWN:g}": _span([row.iterations for row in shown], 0),
        "relaxations that converged": _count([row.status == "CONVERGED" for row in rows]),
    }


def _worst(skins: Sequence[Smoothness]) -> str:
    low, high = min(skin.edges[0] for skin in skins), max(skin.edges[1] for skin in skins)
    folds = _span([skin.fold for skin in skins], 0)
    return f"{low:.2f} to {high:.2f}; {folds}; {_count([skin.good for skin in skins])}"


def _span(values: Sequence[float], digits: int) -> str:
    return f"{min(values):.{digits}f} to {max(values):.{digits}f}"


def _count(met: Sequence[bool]) -> str:
    return f"{sum(met)} of {len(met)}"

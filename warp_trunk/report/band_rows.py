"""How sure each number is, as rows of text and a sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .tables import Row, plain, sided

if TYPE_CHECKING:
    from warp_trunk.results.bands import Band, Bands

BAND_HEAD = (
    "number",
    "predicted",
    "± deviation",
    "19 of 20 between",
    "and",
    "plan met exactly: ±",
    "in proportion",
)
SOURCE_HEAD = ("what is uncertain", "by", "rotation, most [°]", "hump [mm]", "where that comes from")


def band_rows(bands: Bands) -> list[Row]:
    """Every number of the skin, then those of the planned spine."""
    rows = [
        _sided_row(f"{level} [°]", band, bands.exact.get(f"bsr {level}")) for level, band in bands.bsr_deg.items()
    ]
    hump = next((band for name, band in bands.exact.items() if name.startswith("hump ")), None)
    for name, band, exact in (
        ("Hump, largest [mm]", bands.max_hump_mm, hump),
        ("Higher shoulder, by [mm]", bands.shoulder_difference_mm, bands.exact.get("shoulder difference")),
    ):
        if band is not None:
            rows.append(_sided_row(name, band, exact))
    for name, band in bands.spine.items():
        kind, _, ends = name.partition(" ")
        called = kind.removesuffix("_deg").removesuffix("_mm").replace("_", " ").capitalize()
        unit = "°" if kind.endswith("_deg") else "mm"
        cells = [plain(band.value), plain(band.sd), plain(band.low), plain(band.high)]
        rows.append([f"{called} {ends} [{unit}]".replace("  ", " "), *cells, "–", "–"])
    return rows


def source_rows(bands: Bands) -> list[Row]:
    """Every source of error, the largest first: what it alone does."""
    rows = []
    for source in bands.sources:
        rotation = max((sd for name, sd in source.sd.items() if name.startswith("bsr ")), default=None)
        hump = next((sd for name, sd in source.sd.items() if name.startswith("hump ")), None)
        rows.append([source.name, source.spread, plain(rotation, 2), plain(hump, 2), source.reference])
    return rows


def band_sentence(bands: Bands, level: str | None) -> str:
    """What a patient is told of how sure the rotation at a level is; empty where it is not known."""
    band = None if level is None else bands.bsr_deg.get(level)
    if band is None:
        return ""
    low, high = (f"{abs(value):.0f}" for value in (band.low, band.high))
    if round(band.low) * round(band.high) < 0:
        between = f"between {low} degrees with the left side further back and {high} with the right side"
    else:
        least, most = sorted((abs(band.low), abs(band.high)))
        between = f"between {least:.0f} and {most:.0f} degrees"
    rough = "" if band.linear else " That is a rough figure: small errors have uneven effects there."
    return (
        f"In 19 of 20 such operations the back would be turned at {level} {between}, if bones are seen and moved "
        f"as exactly as is usual; what that means stands under \u201cHow sure each number is\u201d.{rough}"
    )


def _sided_row(name: str, band: Band, exact: Band | None) -> Row:
    ends = [sided(value) for value in (band.low, band.high)]
    met = plain(None if exact is None else exact.sd)
    return [name, sided(band.value), plain(band.sd), *ends, met, "yes" if band.linear else "no"]

"""The names of the files of a result folder."""

from pathlib import Path

SUMMARY = "summary.json"
"""Written last: a folder that has it is complete."""
SKIN_BEFORE, PREDICTED_SKIN, ACTUAL_SKIN = "skin_before.ply", "predicted_skin.ply", "actual_skin.ply"
LANDMARKS_BEFORE, LANDMARKS_AFTER = "landmarks_before.csv", "landmarks_after.csv"
UNSEEN_SKIN = "unseen_skin.csv"
TRUNK, SKIN_SD, RECORDING = "trunk.vtu", "skin_sd.csv", "recording.rrd"
SECTIONS = "sections.npz"
"""The sections of every state of a result, with the contacts of its tangents, as they were measured."""
EFFECTS = "effects.npz"
"""Effects of the errors on the numbers of a result with bands, by which plans are compared."""
PLAN, MOST_PLAN = "plan.toml", 1_000_000
"""The plan that made a result or a case, in its folder, and the largest size of one [bytes]."""
MOTIONS = "motions.toml"
"""The motions of bones that made a result or are of a case, in its folder."""
PAGE, PICTURES = "report.html", "report"
"""Files that `report` writes: a page, and a folder of pictures."""
MEASURES = f"{Path(PREDICTED_SKIN).stem}_measures"
"""Files that `measure` writes, without the endings .json and .csv."""


def picture_source(name: str) -> str:
    """The entry `Source` of a picture of a report, by which it is known as one."""
    return f"warp_trunk report, {name}"

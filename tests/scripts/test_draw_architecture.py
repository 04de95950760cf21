"""The picture of the packages is that of the code."""

import draw_architecture


def test_picture_agrees_with_the_imports() -> None:
    """If it fails: python scripts/draw_architecture.py."""
    drawn = draw_architecture.OUT.read_text(encoding="utf-8")
    assert drawn == draw_architecture.drawing(draw_architecture.arrows())


def test_packages_in_a_cycle_stand_side_by_side_and_above_what_they_import() -> None:
    edges = draw_architecture.Counter({("a", "b"): 1, ("b", "c"): 1, ("c", "b"): 2, ("c", "d"): 1})
    assert draw_architecture.floors(edges) == [["d"], ["b", "c"], ["a"]]

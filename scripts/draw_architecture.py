"""Draws docs/architecture.svg: the packages of warp_trunk and their imports, read from the code.

    uv run python scripts/draw_architecture.py

An arrow points down to what is imported; packages that import each other stand side by side. Imports that only
type checkers see are left out. A test compares the picture in docs/ with the code.
"""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
OUT = ROOT / "docs" / "architecture.svg"
WIDTH, HEIGHT, ROW, MARGIN = 132, 40, 96, 24


def arrows(root: Path = ROOT) -> Counter[tuple[str, str]]:
    """How many import statements of one room name another, everywhere in a source, also inside functions."""
    found: Counter[tuple[str, str]] = Counter()
    sources = [(path, "kernels") for path in (root / "kernels").rglob("*.py")]
    sources += [
        (path, path.relative_to(root / "warp_trunk").parts[0]) for path in root.glob("warp_trunk/*/**/*.py")
    ]
    for path, room in sources:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for_types = {part for node in ast.walk(tree) if _for_types(node) for part in ast.walk(node)}
        for node in ast.walk(tree):
            if node in for_types:
                continue
            if isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                parts = node.module.split(".")
                if parts[0] == "warp_trunk" and len(parts) > 1 and parts[1] not in (room, "errors"):
                    found[room, parts[1]] += 1
    return found


def _for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def floors(edges: Counter[tuple[str, str]]) -> list[list[str]]:
    """Rooms from the ground up: each stands above all that it imports; rooms in a circle stand side by side."""
    rooms = sorted({room for edge in edges for room in edge})
    reached = {room: {used for user, used in edges if user == room} for room in rooms}
    for middle in rooms:  # Warshall's transitive closure
        for room in rooms:
            if middle in reached[room]:
                reached[room] |= reached[middle]
    below = {room: {other for other in reached[room] if room not in reached[other]} for room in rooms}
    height = dict.fromkeys(rooms, 0)
    for room in sorted(rooms, key=lambda room: len(below[room])):
        height[room] = 1 + max((height[other] for other in below[room]), default=-1)
    return [[room for room in rooms if height[room] == floor] for floor in range(max(height.values()) + 1)]


def drawing(edges: Counter[tuple[str, str]]) -> str:
    """The picture as SVG, foundations at the bottom."""
    levels = floors(edges)
    across = max(map(len, levels)) * (WIDTH + MARGIN) + MARGIN
    down = len(levels) * ROW + MARGIN
    place = {
        room: (
            (i + 0.5) * across / len(level),
            down - MARGIN - HEIGHT / 2 - floor * ROW,
        )
        for floor, level in enumerate(levels)
        for i, room in enumerate(level)
    }
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {across} {down}" font-family="sans-serif">',
        "<title>The packages of warp_trunk: an arrow points to what is imported</title>",
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" '
        'markerHeight="7" orient="auto">'
        '<path d="M0 0 8 4 0 8z" fill="#557"/></marker></defs>',
        f'<rect width="{across}" height="{down}" fill="white"/>',
    ]
    for user, used in sorted(edges):
        (x0, y0), (x1, y1) = place[user], place[used]
        y0, y1 = y0 + HEIGHT / 2, y1 + (HEIGHT / 2 if y0 == y1 else -HEIGHT / 2)
        bend = (y1 - y0) / 2 or HEIGHT / 2
        back = -bend if y0 == y1 else bend
        lines.append(
            f'<path d="M{x0:.0f} {y0:.0f} C{x0:.0f} {y0 + bend:.0f} {x1:.0f} {y1 - back:.0f} {x1:.0f} {y1:.0f}" '
            f'fill="none" stroke="#557" stroke-opacity="0.55" stroke-width="1.4" '
            f'marker-end="url(#tip)"><title>{user} imports {used}</title></path>'
        )
    for room, (x, y) in place.items():
        lines += [
            f'<rect x="{x - WIDTH / 2:.0f}" y="{y - HEIGHT / 2:.0f}" width="{WIDTH}" height="{HEIGHT}" rx="6" '
            'fill="#eef3fa" stroke="#335"/>',
            f'<text x="{x:.0f}" y="{y + 5:.0f}" text-anchor="middle" font-size="16">{room}</text>',
        ]
    return "\n".join([*lines, "</svg>", ""])


if __name__ == "__main__":
    OUT.write_text(drawing(arrows()), encoding="utf-8")
    print(f"{OUT}: {len(arrows())} arrows between {len({r for e in arrows() for r in e})} rooms")

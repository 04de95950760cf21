"""Names of the engine: each has one meaning, that of the glossary in docs/solver.md."""

from __future__ import annotations

import ast
import importlib
import re
from collections import defaultdict
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import warp_trunk.engine

ENGINE = Path(warp_trunk.engine.__path__[0])
KERNELS = Path(importlib.import_module("warp_trunk.kernels").__path__[0])
GLOSSARY = (Path(__file__).parents[2] / "docs" / "solver.md").read_text(encoding="utf-8").split("\n\n")[1]
UNIT = r"\[[^\]]+\]|\b([Pp]art|[Ff]raction|[Rr]elative|[Rr]oundings|chance|[Ss]tandard deviations|[Nn]umber of)\b"
"""A unit in brackets, or words for a number without one."""


def modules() -> Iterator[ast.Module]:
    for path in sorted([*ENGINE.rglob("*.py"), *KERNELS.glob("*.py")]):
        yield ast.parse(path.read_text(encoding="utf-8"))


def members() -> dict[str, set[str]]:
    """Fields, properties and methods by class."""
    names: dict[str, set[str]] = defaultdict(set)
    for module in modules():
        for node in module.body:
            if isinstance(node, ast.ClassDef):
                for child in node.body:
                    if isinstance(child, ast.AnnAssign) and isinstance(child.target, ast.Name):
                        names[node.name].add(child.target.id)
                    elif isinstance(child, ast.FunctionDef):
                        names[node.name].add(child.name)
    return names


def test_what_the_glossary_names_exists_with_its_unit() -> None:
    classes, rows = members(), GLOSSARY.splitlines()[2:]
    assert len(rows) > 10
    for row in rows:
        term, meaning, _, places = (cell.strip() for cell in row.strip("|").split("|"))
        assert term
        assert meaning
        for owner, member in re.findall(r"`(\w+)\.(\w+)`", places):
            assert member in classes[owner], f"{term}: {owner} has no {member}"


def test_every_real_field_states_its_unit_or_of_what_it_is_a_part() -> None:
    without = []
    for module in modules():
        for owner in (node for node in module.body if isinstance(node, ast.ClassDef)):
            for field, text in pairwise([*owner.body, None]):
                if isinstance(field, ast.AnnAssign) and re.search(r"\bfloat\b", ast.unparse(field.annotation)):
                    meaning = ast.unparse(text) if text is not None else ""
                    if not re.search(UNIT, meaning) and "Callable" not in ast.unparse(field.annotation):
                        without.append(f"{owner.name}.{ast.unparse(field.target)}")
    assert not without

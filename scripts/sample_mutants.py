"""Samples small faults (mutants) of the program by seed, and counts how many of them the fast tests see.

    uv run python scripts/sample_mutants.py --out results/mutants --seed 1 --each 30 --jobs 16

Each test file runs once under coverage, which notes the lines that each test and each shared fixture executes
(`mutant_contexts.py`). A mutant is then given to the tests that execute its statement, those in the folder of its
package first and the quick ones first, until one fails; after them to the other tests of those files, as what is
cached or imported runs in the first test that asks for it. Each worker changes its own copy of the tree. Outcomes
are written as they come, so a run that was stopped goes on where it ended. `mutants.md` under --out holds the
rates and the survivors.

Operators are those of cosmic-ray that `[tool.cosmic-ray]` in pyproject.toml leaves, and three below. `_left_out`
leaves out what is written for people or type checkers (docstrings, annotations), the style of pictures, and guards
against a programmer's fault.
"""

import ast
import contextlib
import difflib
import io
import itertools
import json
import os
import queue
import random
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
import tokenize
import tomllib
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import coverage
import parso.python.tree as syntax
import tyro
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.provider import OperatorProvider

ROOT = Path(__file__).parents[1]
PACKAGES = ("results", "run", "report", "recording", "live", "cohort", "cli", "case", "meshing", "measures")
PYTEST = (sys.executable, "-m", "pytest", "-q", "--no-header", "--tb=no", "-rfE", "-p", "no:cacheprovider")

STYLE_ARGUMENTS = re.compile(
    r"alpha|antialiased|\w*pad|bbox\w*|c|capsize|cmap|\w*colors?|dpi|figsize|font\w+|frameon|gridspec_kw|ha|layout"
    r"|line(style|width)s?|loc|lw|ls|marker(size)?|me[cw]|ms|opacity|radii|s|style|thickness|va|widths?|\w+_ratios"
    r"|[hw]space|zorder|help|metavar"
)
"""Keyword arguments that style a picture or word a help text."""
STYLE_CALLS = re.compile(
    r"(.*\.)?(grid|tick_params|set_axis_off|set_aspect|legend|subplots_adjust|tight_layout|new_figure|cast)"
)
"""Functions that style or size a picture, and what is for type checkers."""
STYLE_NAMES = re.compile(r"_?[A-Z_]*(COLOU?RS?|DPI|FONT|WIDTH|SIZE|STYLE|GRE[AY]|ALPHA|MARGIN|RADIUS)[A-Z_]*")
"""Names of constants that style a picture."""
COLOUR = re.compile(r"\(\d+, \d+, \d+(, \d+)?\)|\[0\.\d+, 0\.\d+, 0\.\d+\]")
"""Red, green and blue, as bytes or as parts of one."""
GUARDS = re.compile(r"strict|frozen|kw_only|slots|eq")
"""Keyword arguments of `zip` and `dataclass` that guard against a programmer's fault and change no result."""
NO_EFFECT = re.compile(r"(.*\.)?(cache|lru_cache|cached_property|overload|override|final|dataclass)(\(.*)?")
"""Decorators that change no result when they go, only the time until it is there, or stop every import."""


class DropKeyword:
    """Drops a keyword argument of a call: an option that is accepted and ignored."""

    def mutation_positions(self, node: Any) -> Iterator[Any]:
        for argument in self._arguments(node):
            yield argument.start_pos, argument.end_pos

    def mutate(self, node: Any, index: int) -> Any:
        argument = self._arguments(node)[index]
        place = node.children.index(argument)
        comma = [place + 1] if node.type == "arglist" and place + 1 < len(node.children) else []
        node.children = [child for i, child in enumerate(node.children) if i != place and i not in comma]
        return node

    @staticmethod
    def _arguments(node: Any) -> list[Any]:
        if node.type not in {"arglist", "trailer"}:
            return []
        return [child for child in node.children if child.type == "argument" and child.children[1] == "="]


class DropCall:
    """Drops a statement that is a call: a warning that vanishes, a file that is not written."""

    def mutation_positions(self, node: Any) -> Iterator[Any]:
        call = (
            node.type == "simple_stmt" and node.children[0].type == "atom_expr" and node.children[0].children[-1]
        )
        if call and call.get_code().startswith("("):
            yield node.start_pos, node.end_pos

    def mutate(self, node: Any, index: int) -> Any:
        first = node.get_first_leaf()
        node.children[0] = syntax.Keyword("pass", first.start_pos, prefix=first.prefix)
        return node


class ExchangeSides:
    """Exchanges left and right in a text or an attribute's name."""

    def mutation_positions(self, node: Any) -> Iterator[Any]:
        text = node.type in {"string", "fstring_string"} and re.search(r"\b(left|right)\b", node.value)
        if text or (node.type == "name" and node.value in {"left", "right"} and node.get_previous_leaf() == "."):
            yield node.start_pos, node.end_pos

    def mutate(self, node: Any, index: int) -> Any:
        other = {"left": "right", "right": "left"}
        node.value = re.sub(r"\b(left|right)\b", lambda side: other[side[0]], node.value)
        return node


Copies: TypeAlias = "queue.Queue[tuple[Path, int]]"
"""Copies of the tree that are free, each with its core."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """The sample and how it is tested."""

    out: Path
    """Folder of the outcomes; a run that was stopped goes on from it."""
    seed: int = 1
    """Of the sample."""
    each: int = 30
    """Mutants of each package."""
    packages: tuple[str, ...] = PACKAGES
    """Packages that are changed."""
    jobs: int = os.cpu_count() or 1
    """Mutants that are tested at once, each on one core in its copy of the tree."""
    budget: float = 60.0
    """Seconds of tests, as they took once, after which no further test is given to a mutant."""


@dataclass(frozen=True)
class Mutant:
    """A changed file."""

    path: str
    """Relative to the tree."""
    line: int
    before: str
    """The changed lines."""
    after: str
    text: str
    """All of the file with the fault."""

    @property
    def name(self) -> str:
        """Names the change even when lines above it move."""
        return f"{self.path} `{self.before}` -> `{self.after}`"

    @property
    def place(self) -> str:
        return f"{self.path}:{self.line}"

    def executed_lines(self) -> set[int]:
        """The lines of the innermost statement that is changed, of a compound one those of its head."""
        spans = _spans((ROOT / self.path).read_text(encoding="utf-8"))
        around = [(low, high) for low, high in spans if low <= self.line <= high]
        low, high = min(around, key=lambda span: span[1] - span[0], default=(self.line, self.line))
        return set(range(low, high + 1))


@dataclass(frozen=True)
class Tested:
    """A test file as it ran on the unchanged tree; tests that fail there are left out."""

    path: str
    tests: dict[str, tuple[float, list[str]]] = field(default_factory=dict)
    """By id: seconds of the test alone, and its shared fixtures."""
    fixtures: dict[str, float] = field(default_factory=dict)
    """Seconds of each shared fixture."""
    executed: dict[str, set[str]] = field(default_factory=dict)
    """Tests and shared fixtures that execute a statement with a mutant, by its place; "" for what is imported."""

    def asked(self, place: str) -> list[tuple[bool, str]]:
        """Tests for a statement, and whether they are asked later, as they do not execute it themselves."""
        contexts = self.executed.get(place, set())
        own = {name for name, (_, fixtures) in self.tests.items() if contexts.intersection([name, *fixtures])}
        return [(name not in own, name) for name in self.tests] if contexts else []

    def seconds(self, name: str) -> float:
        """Of a test with its shared fixtures."""
        alone, fixtures = self.tests[name]
        return alone + sum(self.fixtures[fixture] for fixture in fixtures)


def main(options: Options) -> None:
    """Samples, tests and reports."""
    options.out.mkdir(parents=True, exist_ok=True)
    copies, mutants = _copies(options), sample(options)
    tests = _measured_tests(options, mutants, copies)
    outcomes = _outcomes(options, mutants, tests, copies)
    table = report(mutants, outcomes, options)
    (options.out / "mutants.md").write_text(table, encoding="utf-8", newline="\n")
    print(table)


def sample(options: Options) -> list[Mutant]:
    """Mutants of each package, drawn by the seed: places are equally likely, then the changes possible there."""
    files = {package: sorted(ROOT.glob(f"warp_trunk/{package}/**/*.py")) for package in options.packages}
    drawn: list[Mutant] = []
    every = list(itertools.chain(*files.values()))
    with ProcessPoolExecutor(options.jobs) as pool:
        possible = dict(zip(every, pool.map(_changes, every), strict=True))
    for package, paths in files.items():
        draw = random.Random(f"{options.seed} {package}")
        places = [(path, changes) for path in paths for changes in possible[path]]
        draw.shuffle(places)
        mutants = (_mutant(path, draw.choice(changes)) for path, changes in places)
        drawn += itertools.islice((mutant for mutant in mutants if mutant), options.each)
    return drawn


@cache
def _operators() -> dict[str, Any]:
    """The operators by name, without those that the configuration excludes."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    excluded = project["tool"]["cosmic-ray"]["filters"]["operators-filter"]["exclude-operators"]
    provider: Any = OperatorProvider()
    names = [name for name in provider if not any(re.match(regex, f"core/{name}") for regex in excluded)]
    own = (DropKeyword, DropCall, ExchangeSides)
    return {name: provider[name]() for name in names} | {operator.__name__: operator() for operator in own}


def _changes(path: Path) -> list[list[tuple[str, int, int]]]:
    """Operator, occurrence and line of each possible change of a file, grouped by place and kind."""
    text = path.read_text(encoding="utf-8")
    left_out = _left_out(text)
    nodes = list(ast_nodes(get_ast(text)))
    groups: defaultdict[tuple[Any, str], list[tuple[str, int, int]]] = defaultdict(list)
    for name, operator in _operators().items():
        positions = (position for node in nodes for position in operator.mutation_positions(node))
        for occurrence, (start, end) in enumerate(positions):
            if not any(low <= start < high for low, high in left_out):
                groups[(start, end), name.partition("_")[0]].append((name, occurrence, start[0]))
    return list(groups.values())


def _left_out(text: str) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Ranges that are for people's eyes or for type checkers alone, as (line, column) from and to."""
    rows = text.splitlines()
    nodes: list[Any] = []
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Expr(value=ast.Constant()):  # a docstring
                nodes.append(node)
            case ast.arg(annotation=kind) | ast.AnnAssign(annotation=kind) | ast.FunctionDef(returns=kind) if kind:
                nodes.append(kind)
            case ast.If(test=ast.Name(id="TYPE_CHECKING")):
                nodes.append(node)
            case ast.Call(func=called) if STYLE_CALLS.fullmatch(ast.unparse(called)):
                nodes.append(node)
            case ast.keyword(arg=str(name)) if STYLE_ARGUMENTS.fullmatch(name) or GUARDS.fullmatch(name):
                nodes.append(node)
            case ast.Dict():  # of keyword arguments
                keys = [getattr(key, "value", None) for key in node.keys]
                styles = zip(keys, node.values, strict=True)
                nodes += [
                    value for key, value in styles if isinstance(key, str) and STYLE_ARGUMENTS.fullmatch(key)
                ]
            case ast.Assign(targets=[ast.Name(id=name)]) if STYLE_NAMES.fullmatch(name):
                nodes.append(node)
            case ast.Tuple() | ast.List() if COLOUR.fullmatch(ast.unparse(node)):
                nodes.append(node)
        for decorator in getattr(node, "decorator_list", []):
            if NO_EFFECT.fullmatch(ast.unparse(decorator)):
                nodes.append(decorator)

    def place(line: int, offset: int) -> tuple[int, int]:
        start = rows[line - 1].encode()[:offset].decode()
        return line, len(start) - start.endswith("@")

    ranges = [(place(node.lineno, node.col_offset), place(node.end_lineno, node.end_col_offset)) for node in nodes]
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    stars = [star for star, after in itertools.pairwise(tokens) if star.string == "*" and after.string == ","]
    return ranges + [(star.start, star.end) for star in stars]  # keyword-only: a programmer's guard


def _mutant(path: Path, change: tuple[str, int, int]) -> Mutant | None:
    """The mutant of a change, or None where it is no program, or the same one."""
    operator, occurrence, line = change
    text = path.read_text(encoding="utf-8")
    mutated = str(mutate_code(text, _operators()[operator], occurrence))
    try:
        if ast.dump(ast.parse(mutated)) == ast.dump(ast.parse(text)):
            return None
    except SyntaxError:
        return None
    lines = list(difflib.unified_diff(text.splitlines(), mutated.splitlines(), n=0, lineterm=""))[3:]
    before, after = (" ".join(row[1:].strip() for row in lines if row[0] == sign) for sign in "-+")
    return Mutant(str(path.relative_to(ROOT)), line, before, after, mutated)


def _copies(options: Options) -> Copies:
    """A copy of the tree for each worker, with the core it keeps to."""
    folder = options.out / "trees"
    shutil.rmtree(folder, ignore_errors=True)
    usable = sorted(os.sched_getaffinity(0)) if sys.platform == "linux" else range(os.cpu_count() or 1)
    copies: Copies = queue.Queue()
    for number, core in zip(range(options.jobs), itertools.cycle(usable), strict=False):
        tree = (folder / str(number)).absolute()
        for name in ("warp_trunk", "kernels", "tests", "scripts", "docs"):
            shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
        for path in filter(Path.is_file, ROOT.iterdir()):
            shutil.copy2(path, tree)
        (tree / "warp_trunk" / "kernels").symlink_to("../kernels")  # as the installed package has it
        copies.put((tree, core))
    return copies


@dataclass(frozen=True)
class Ended:
    """A run of tests."""

    status: int | None
    """None when it was stopped, as it hung."""
    output: str
    seconds: float


def _run(command: Sequence[str], copy: tuple[Path, int], limit: float, **environment: str) -> Ended:
    """Runs tests in a copy of the tree on its core, with nothing kept from earlier runs."""
    tree, core = copy
    scratch = tree.parent / f"kept{tree.name}"
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir()
    path = os.pathsep.join([str(tree), str(tree / "scripts"), *filter(None, [os.environ.get("PYTHONPATH")])])
    variables = os.environ | {"PYTHONPATH": path, "WARP_TRUNK_CACHE": str(scratch / "cache"), **environment}
    started = time.monotonic()
    log = scratch / "output"
    with log.open("w", encoding="utf-8", newline="\n") as output:
        arguments = [*command, f"--basetemp={scratch / 'tests'}"]
        process = subprocess.Popen(
            arguments, cwd=tree, env=variables, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
        )
        if sys.platform == "linux":
            os.sched_setaffinity(process.pid, {core})
        try:
            status = process.wait(limit)
        except subprocess.TimeoutExpired:
            status = None
        with contextlib.suppress(ProcessLookupError):
            if sys.platform == "win32":
                process.kill()
            else:
                os.killpg(process.pid, signal.SIGKILL)  # and what it started
        process.wait()
    return Ended(status, log.read_text(encoding="utf-8", errors="replace"), time.monotonic() - started)


def _measured_tests(options: Options, mutants: list[Mutant], copies: Copies) -> list[Tested]:
    """Runs each test file once under coverage, the large ones first."""
    files = sorted(ROOT.glob("tests/**/test_*.py"), key=lambda path: -path.stat().st_size)
    places = {mutant.place: (mutant.path, mutant.executed_lines()) for mutant in mutants}

    def measure(path: Path) -> Tested:
        copy = copies.get()
        try:
            return _measured(str(path.relative_to(ROOT)), places, copy)
        finally:
            copies.put(copy)

    with ThreadPoolExecutor(options.jobs) as pool:
        return list(pool.map(measure, files))


def _measured(name: str, places: dict[str, tuple[str, set[int]]], copy: tuple[Path, int]) -> Tested:
    data, seconds = (copy[0].parent / f"{what}{copy[0].name}" for what in ("coverage", "seconds"))
    for old in [*data.parent.glob(f"{data.name}.*"), seconds]:
        old.unlink(missing_ok=True)
    under = [sys.executable, "-m", "coverage", "run", f"--data-file={data}.data", *PYTEST[1:], name]
    ended = _run(
        [*under, "-p", "mutant_contexts"], copy, limit=300, COVERAGE_CORE="ctrace", MUTANT_SECONDS=str(seconds)
    )
    print(f"{name}: {ended.seconds:.0f} s, {len(_failed(ended.output))} failed", flush=True)
    if ended.status not in {0, 1, 5} or not seconds.exists():  # passed, some failed, none selected
        print(f"it did not end:\n{ended.output[-2000:]}", flush=True)
        return Tested(name)
    collected = coverage.Coverage(data_file=f"{data}.data", config_file=str(copy[0] / "pyproject.toml"))
    collected.combine([str(path) for path in data.parent.glob(f"{data.name}.data*")])
    lines, executed = collected.get_data(), {}
    for place, (path, statement) in places.items():
        contexts = lines.contexts_by_lineno(str(copy[0] / path))
        if by := {context for line in statement for context in contexts.get(line, ())}:
            executed[place] = by
    measured = json.loads(seconds.read_text(encoding="utf-8"))
    able = {test: own for test, own in measured["tests"].items() if test not in _failed(ended.output)}
    return Tested(name, able, measured["fixtures"], executed)


def _failed(output: str) -> list[str]:
    return re.findall(r"^(?:FAILED|ERROR) (.*?)(?: - .*)?$", output, flags=re.MULTILINE)


def _outcomes(
    options: Options, mutants: list[Mutant], tests: list[Tested], copies: Copies
) -> dict[str, dict[str, Any]]:
    """Tests each mutant whose outcome is not written yet."""
    written, lock = options.out / "outcomes.jsonl", threading.Lock()
    lines = written.read_text(encoding="utf-8").splitlines() if written.exists() else []
    outcomes = {row["mutant"]: row for row in (json.loads(line) for line in lines if line.endswith("}"))}

    def judge(mutant: Mutant) -> None:
        copy = copies.get()
        try:
            outcome = {
                "mutant": mutant.name,
                "place": mutant.place,
                **_judged(mutant, tests, copy, options.budget),
            }
        finally:
            _write(copy[0] / mutant.path, (ROOT / mutant.path).read_text(encoding="utf-8"))
            copies.put(copy)
        with lock, written.open("a", encoding="utf-8", newline="\n") as file:
            outcomes[mutant.name] = outcome
            file.write(json.dumps(outcome) + "\n")
            print(f"{len(outcomes)}/{len(mutants)} {outcome['outcome']} {mutant.name[:150]}", flush=True)

    left = [mutant for mutant in mutants if mutant.name not in outcomes]
    random.Random(options.seed).shuffle(left)  # so that a part of them says something of each package
    with ThreadPoolExecutor(options.jobs) as pool:
        list(pool.map(judge, left))
    return outcomes


def _write(path: Path, text: str) -> None:
    """Writes a file under a time of its own, as bytecode is kept by size and second, which a fault often keeps."""
    path.write_text(text, encoding="utf-8", newline="\n")
    at = next(_TIMES)
    os.utime(path, (at, at))


_TIMES = itertools.count(1_000_000_000)


def _judged(mutant: Mutant, tests: list[Tested], copy: tuple[Path, int], budget: float) -> dict[str, Any]:
    """The outcome of a mutant."""
    folder = f"tests/{Path(mutant.path).parts[1]}/"
    asked = sorted(
        (
            (later, not test.path.startswith(folder), test.seconds(name), name, test)
            for test in tests
            for later, name in test.asked(mutant.place)
        ),
        key=lambda each: each[:4],
    )
    within, left_out, total, ready = [], [], 0.0, set[tuple[str, str]]()
    for later, _, _, name, test in asked:
        alone, fixtures = test.tests[name]
        new = {(test.path, fixture) for fixture in fixtures} - ready
        seconds = alone + sum(test.fixtures[fixture] for _, fixture in new)
        if total + seconds <= budget:
            within.append(name)
            total, ready = total + seconds, ready | new
        elif not later:
            left_out.append(name)
    outcome, by = "survived", "" if asked else "no test executes it"
    if within:
        _write(copy[0] / mutant.path, mutant.text)
        chosen = copy[0].parent / f"chosen{copy[0].name}"  # more than a command line may hold
        chosen.write_text("\n".join(within), encoding="utf-8", newline="\n")
        ended = _run([*PYTEST, "-x", f"@{chosen}"], copy, 3 * total + 60)
        if ended.status not in {0, 5}:
            outcome = "killed"
            by = "hung" if ended.status is None else next(iter(_failed(ended.output)), "no import")
    return {"outcome": outcome, "by": by, "left_out": left_out}


@cache
def _spans(text: str) -> tuple[tuple[int, int], ...]:
    """First and last line of each statement, of a compound one its head."""
    spans = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.stmt | ast.ExceptHandler):
            body = getattr(node, "body", None)
            first = min([node.lineno, *(each.lineno for each in getattr(node, "decorator_list", []))])
            spans.append((first, max(node.lineno, body[0].lineno - 1) if body else node.end_lineno or node.lineno))
    return tuple(spans)


def report(mutants: list[Mutant], outcomes: dict[str, dict[str, Any]], options: Options) -> str:
    """The rates by package and the survivors."""
    rows = [f"Mutants of seed {options.seed}, {options.each} of each package.", ""]
    rows += ["| package | tested | killed | undecided | rate of those decided |", "|---|---|---|---|---|"]
    groups: defaultdict[str, list[dict[str, Any]]] = defaultdict(list)
    for mutant in mutants:
        if mutant.name in outcomes:
            groups[Path(mutant.path).parts[1]].append(outcomes[mutant.name])
    for package, judged in [*groups.items(), ("all", [each for group in groups.values() for each in group])]:
        killed = sum(each["outcome"] == "killed" for each in judged)
        undecided = sum(each["outcome"] == "survived" and bool(each["left_out"]) for each in judged)
        rate = killed / max(len(judged) - undecided, 1)
        rows.append(f"| {package} | {len(judged)} | {killed} | {undecided} | {rate:.0%} |")
    rows += ["", "Survivors:", ""]
    for mutant in mutants:
        outcome = outcomes.get(mutant.name)
        if outcome and outcome["outcome"] == "survived":
            unexecuted = "not executed, " if outcome["by"] else "undecided, " if outcome["left_out"] else ""
            rows.append(f"- {mutant.place} {unexecuted}`{mutant.before}` -> `{mutant.after}`:")
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    main(tyro.cli(Options))

"""This program and its peers on the same neo-Hookean problem, to the same true error.

    uv run --group fem python scripts/compare_peers.py measure phantom=86500 CASE=134000 --json docs/peers.json
    uv run python scripts/compare_peers.py table docs/peers.json --page docs/performance.md

Every peer runs in a process of its own on the same cores (`peers/with_*.py`), is warm, and is stopped as soon
as its true error is small enough; one that is not installed says how to get it. The truth is this program's end
in float64 to 1e-6 mm; for a peer whose neo-Hookean law is another one it is that law's, by scikit-fem. `phantom`
stands for the built-in phantom.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from benchmarking.prepare import load_case, mesh_case
from benchmarking.problem import Problem, solve_truth
from benchmarking.process import be_quiet
from benchmarking.record import hardware
from finite_elements.linear import available
from finite_elements.newton import equilibrium
from finite_elements.solid import Solid
from marked import write_into
from peers.other_work import cores_of_others, taken
from peers.registry import ENTRIES, OURS, Entry
from peers.rows import Row, read_rows, write_rows
from peers.table import markdown
from peers.task import Task, read_answer, write_task
from peers.timing import ROUNDS, TIGHT

ACCURACY = 0.01
"""Largest distance of a node from the truth [mm]."""
SCRIPTS = Path(__file__).resolve().parent


def main(arguments: Sequence[str] | None = None) -> None:
    """Measures, or prints what was measured."""
    given = _parser().parse_args(arguments)
    given.command(given)


def measure(given: argparse.Namespace) -> None:
    """Every peer asked for on every problem; writes after each."""
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: given.cores])
    be_quiet()
    rows: list[Row] = []
    for what in given.problems:
        name, _, tets = what.partition("=")
        problem = mesh_case(load_case(name), int(tets or 86_500))
        for row in compare(replace(problem, energy="neo-hookean"), given):
            rows.append(row)
            write_rows(given.json, rows)
            print(row.peer, row.why_not or row.best(ACCURACY), f"apart {row.apart_mm}", flush=True)
    table(argparse.Namespace(json=given.json, page=None))


def table(given: argparse.Namespace) -> None:
    """Prints the tables, or puts them into a page."""
    text = markdown(read_rows(given.json), ACCURACY)
    if given.page is None:
        print(text)
    else:
        write_into(given.page, "peers", text)


def compare(problem: Problem, given: argparse.Namespace) -> Iterator[Row]:
    """One problem, one peer after another."""
    task = make_task(problem)
    truths = {ENTRIES[0].law: task.truth}
    for entry in ENTRIES:
        if entry.name not in given.peers and entry.name != OURS:
            continue
        row = Row(
            problem=problem.name,
            tets=len(task.tets),
            free_nodes=int((~task.held).sum()),
            peer=entry.name,
            law=entry.law.__name__,
            favour=entry.favour,
            hardware=hardware("cpu"),
        )
        missing = entry.missing()
        if missing:
            yield replace(row, why_not=f"not installed: {missing}")
            continue
        if entry.law not in truths:
            truths[entry.law] = truth_of(task, entry)
        yield answered(row, entry, replace(task, truth=truths[entry.law]), task.truth, given)


def make_task(problem: Problem) -> Task:
    """The problem with this program's end as the truth."""
    trunk, tissue = problem.trunk, problem.tissue
    return Task(
        nodes=trunk.nodes,
        tets=trunk.tets,
        held=trunk.prescribed,
        image=problem.bone_path().displacement,
        truth=solve_truth(problem),
        youngs_modulus=1e-3 * tissue.youngs_modulus,
        poisson_ratio=tissue.poisson_ratio,
        accuracy=ACCURACY,
    )


def truth_of(task: Task, entry: Entry) -> np.ndarray:
    """The equilibrium of another law, by scikit-fem from this program's."""
    solid = Solid(task.nodes, task.tets, entry.law(task.youngs_modulus, task.poisson_ratio))
    factorise = next(iter(available().values()))
    return equilibrium(solid, task.truth, task.held, factorise, tolerance=TIGHT, keep=0.3).displacement


def answered(row: Row, entry: Entry, task: Task, ours: np.ndarray, given: argparse.Namespace) -> Row:
    """The row with what the peer's own process found."""
    threads = {name: str(entry.threads) for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS")}
    environment = {**os.environ, **threads, "PYTHONPATH": str(SCRIPTS)}
    with tempfile.TemporaryDirectory(prefix="compare-peers-") as folder:
        asked, answer = Path(folder) / "task.npz", Path(folder) / "answer.npz"
        write_task(asked, task)
        command = [*entry.command, "-m", f"peers.{entry.module}", str(asked), str(answer)]
        command += ["--rounds", str(given.rounds), "--limit", str(given.limit)]
        before = taken()
        try:
            made = subprocess.run(
                command, env=environment, capture_output=True, text=True, timeout=given.timeout, check=False
            )
        except subprocess.TimeoutExpired:
            return replace(row, why_not=f"no answer within {given.timeout:g} s")
        row = replace(row, others=round(cores_of_others(before, taken()), 2))
        if made.returncode or not answer.exists():
            last = [line for line in made.stderr.strip().splitlines() if line][-1:] or [
                f"status {made.returncode}"
            ]
            return replace(row, why_not=f"failed: {last[0].strip()}")
        found = read_answer(answer)
    end = task.truth if entry.law is not ENTRIES[0].law else found.converged
    apart = None if end is None else float(np.linalg.norm(end - ours, axis=1).max())
    return replace(row, version=found.version, runs=tuple(found.runs), apart_mm=apart)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    one = commands.add_parser("measure", help="run the peers, keep their times as JSON and print the tables")
    one.set_defaults(command=measure)
    one.add_argument("problems", nargs="+", help="case folder or phantom, = and about how many tetrahedra")
    one.add_argument("--json", type=Path, default=Path("peers.json"), help="(default %(default)s)")
    one.add_argument("--peers", nargs="+", choices=[e.name for e in ENTRIES], default=[e.name for e in ENTRIES])
    one.add_argument("--cores", type=int, default=2, help="of this machine (default %(default)s)")
    one.add_argument(
        "--rounds", type=int, default=ROUNDS, help="of which the least time counts (default %(default)s)"
    )
    one.add_argument(
        "--limit", type=float, default=30.0, help="no further round after this [s] (default %(default)g)"
    )
    one.add_argument(
        "--timeout", type=float, default=120.0, help="of one peer on one problem [s] (default %(default)g)"
    )
    one = commands.add_parser("table", help="print the tables of what was measured, or put them into a page")
    one.set_defaults(command=table)
    one.add_argument("json", type=Path, help="made by measure")
    one.add_argument("--page", type=Path, help="page with the two marks between which the tables stand")
    return parser


if __name__ == "__main__":
    sys.exit(main())

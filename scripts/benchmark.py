"""Speed against error, measured.

    python scripts/benchmark.py prepare CASE --tets 225000 --out problem.npz      mesh and truth, in one file
    python scripts/benchmark.py run problem.npz --out benchmark.json              error against time
    python scripts/benchmark.py table benchmark.json                              Markdown, or --page PAGE
    python scripts/benchmark.py scenes problem.npz                                what each part of a scene costs
    python scripts/benchmark.py scale CASE --tets 150000 225000 500000            growth with the mesh

`phantom` stands for the built-in phantom instead of a case folder. All but `prepare`, and `scale` of a case,
run where only numpy, scipy and warp are installed. Times are wall clock after set-up; kernels compile apart.
"""

import argparse
import itertools
import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

from benchmarking import curves, outside, scaling, scenes, tables
from benchmarking.prepare import as_simulated, load_case, mesh_case
from benchmarking.problem import Problem, read_problem, solve_truth, write_problem
from benchmarking.process import be_quiet, empty_kernel_cache, fresh
from benchmarking.record import Record, Setting, read_records, write_records

from warp_trunk import InputError, RunOptions
from warp_trunk.engine.energies.by_name import EnergyName
from warp_trunk.engine.parallel import choose_device

Add = Callable[..., argparse.Action]
"""Adds an option to a command."""
PRECISIONS = ("float32", "float64")
METHODS = ("newton", "gradient", outside.OUTSIDE)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command; returns the exit status."""
    options = _parser().parse_args(arguments)
    be_quiet()
    try:
        options.command(options)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def prepare(options: argparse.Namespace) -> None:
    """Meshes a case and solves it for the truth."""
    case = load_case(options.case)
    problem = mesh_case(case, options.tets, options.bone_edge_length)
    problem = as_simulated(problem, case, RunOptions(bones=options.bones, energy=options.energy))
    if options.truth:
        problem = replace(problem, truth=solve_truth(problem))
    write_problem(options.out, problem)
    print(f"{options.out}: {len(problem.trunk.tets)} tets, {Path(options.out).stat().st_size / 1e6:.1f} MB")


def run(options: argparse.Namespace) -> None:
    """Measures every curve in a process of its own and writes the records after each."""
    problem = read_problem(options.problem)
    problem.errors(problem.bone_path().displacement)  # says now if there is no truth
    records: list[Record] = []
    older = read_records(options.out) if Path(options.out).exists() else []
    compiled: dict[tuple[str, str], float] = {}
    settings = choose_settings(options, problem)

    def measure_all() -> None:
        for setting in settings:
            at = (setting.device, setting.precision)
            if options.compile and at not in compiled:
                compiled[at] = fresh(curves.measure_compilation, options.problem, setting)
            records.extend(fresh(curves.measure_curve, options.problem, setting, options.limit, compiled.get(at)))
            write_records(options.out, tables.latest([older, records]))

    with empty_kernel_cache() if options.compile else nullcontext():
        measure_all()
    rule = f"no run is begun that would take over {options.limit:g} s"
    print(f"{problem.name}, {len(problem.trunk.tets)} tets; {rule}\n")
    print_table(records)


def table(options: argparse.Namespace) -> None:
    """Prints the table, or writes it into a page."""
    records = read_records(options.records)
    if options.page is None:
        print_table(records)
    else:
        options.page.write_text(
            tables.replaced(options.page.read_text(encoding="utf-8"), tables.short_table(records)),
            encoding="utf-8",
            newline="\n",
        )


def choose_settings(options: argparse.Namespace, problem: Problem) -> list[Setting]:
    """Every combination asked for that exists; SciPy only in float64, on the most threads."""
    settings = []
    for device, method, precision in itertools.product(options.devices, options.methods, options.precisions):
        choose_device(device)
        threads = options.threads if device == "cpu" else [1]
        if method == outside.OUTSIDE:
            if device != "cpu" or precision != options.precisions[0]:
                continue
            if not outside.available():
                print(f"{method}: left out, SciPy is not installed", file=sys.stderr)
                continue
            precision, threads = "float64", [max(threads)]
        settings += [
            Setting(
                method=method,
                threads=count,
                precision=precision,
                device=device,
                energy=problem.energy,
                bones="spline" if problem.path is None else "follow",
            )
            for count in threads
        ]
    return settings


def print_table(records: Sequence[Record]) -> None:
    """How long kernels compile, and the table."""
    for record in {(r.device, r.precision): r for r in records}.values():
        if record.compile_seconds is not None:
            print(f"- {record.hardware}, {record.precision}: kernels compile in {record.compile_seconds:.0f} s")
    print(f"\n{tables.short_table(records)}")


def scene_costs(options: argparse.Namespace) -> None:
    """Prints the table of what each part of a scene costs."""
    print(scenes.scenes_table(read_problem(options.problem), _setting(options)))


def scale(options: argparse.Namespace) -> None:
    """Prints the tables of mesh sizes and of increments."""
    measured = scaling.sizes(options.what, options.tets, _setting(options))
    for name, group in itertools.groupby(measured, key=lambda size: size.name):
        print(f"\n{name}, {options.device}, {options.precision}\n")
        print(scaling.size_table(list(group)))


def _setting(options: argparse.Namespace) -> Setting:
    choose_device(options.device)
    threads = options.threads if options.device == "cpu" else 1
    return Setting(method="newton", threads=threads, precision=options.precision, device=options.device)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def add(name: str, command: object, words: str, first: str, of_first: str, **more: Any) -> Add:
        added = commands.add_parser(name, help=words, description=words, allow_abbrev=False)
        added.set_defaults(command=command)
        added.add_argument(first, help=of_first, **more)
        return added.add_argument

    problem = "a file made by prepare"
    option = add("prepare", prepare, "mesh a case and solve it to 1e-6 mm", "case", "a case folder, or phantom")
    option("--tets", type=int, default=225_000, help="number of tetrahedra (default %(default)s)")
    option("--bone-edge-length", type=float, default=0.0, help="of the bone surface [mm]; 0 chooses it")
    option("--bones", choices=("follow", "spline"), default="spline", help="how bones are carried")
    option("--energy", choices=get_args(EnergyName), help="of the tissue; left out as simulate has it")
    option("--no-truth", dest="truth", action="store_false", help="mesh only, for scale")
    option("--out", required=True, help="the file, .npz")

    option = add("run", run, "measure error against time", "problem", problem)
    option("--out", default="benchmark.json", help="records; the same curves in it are replaced")
    option("--devices", nargs="+", default=["cpu"], help="cpu, cuda:0 (default cpu)")
    option("--methods", nargs="+", choices=METHODS, default=METHODS)
    option("--threads", nargs="+", type=int, default=[1, 2], help="CPU threads (default 1 2)")
    option("--precisions", nargs="+", choices=PRECISIONS, default=PRECISIONS)
    option("--limit", type=float, default=20.0, help="longest run of a method [s] (default %(default)g)")
    option("--no-compile", dest="compile", action="store_false", help="do not measure compilation")

    option = add("table", table, "print the table of run again", "records", "a file made by run")
    option("--page", type=Path, help="write it between its two marks in this page")

    scene = add("scenes", scene_costs, "what each part of a scene costs", "problem", problem)
    size = add("scale", scale, "growth with the mesh", "what", f"a case folder, phantom, or {problem}", nargs="+")
    size("--tets", nargs="+", type=int, default=[150_000, 225_000, 500_000, 1_000_000])
    for option in (scene, size):
        option("--device", default="cpu", help="cpu or cuda:0 (default %(default)s)")
        option("--threads", type=int, default=2, help="CPU threads (default %(default)s)")
        option("--precision", choices=PRECISIONS, default="float32")
    return parser


if __name__ == "__main__":
    sys.exit(main())

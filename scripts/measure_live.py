"""How fast the planning page follows: a slider dragged without a browser, as a client of its own would.

    python scripts/measure_live.py CASE [--wishes 30] [--device cpu] [--minutes 0] [--page]

Prints the time from a wish to its image and to its skin relaxed to 1 mm and to the end, also as a ratio to one
evaluation of the energy in the same run, for machines are never alike, and the updates a second where each waits
for its relaxed skin. With --page it is measured at the other end of the page's own websocket, from the slider's
message to the vertices that answer it. With --minutes the slider is dragged on, 20 wishes a second as a browser
sends them, and the memory is printed.
"""

from __future__ import annotations

import argparse
import threading
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import psutil
import warp as wp

from warp_trunk import RelaxOptions, RunOptions, SimulationOptions, read_case
from warp_trunk.live.session import Measured, Refusal, Session, View
from warp_trunk.live.wish import Wish, first_wish, spine_before
from warp_trunk.recording.viewer import free_port
from warp_trunk.run.patient import Patient, patient_of

EVERY = 0.05
"""From one wish of a browser to the next [s]."""


class Clock:
    """When each kind of view of a wish was there first."""

    def __init__(self) -> None:
        self._asked = 0.0
        self._wish: Wish | None = None
        self._there = threading.Condition()
        self.image = self.near = self.settled = self.error = np.nan

    def ask(self, session: Session, wish: Wish) -> None:
        with self._there:
            self.image = self.near = self.settled = np.nan
            self._asked, self._wish = time.perf_counter(), wish
        session.ask(wish)

    def __call__(self, told: View | Refusal | Measured) -> None:
        with self._there:
            if not isinstance(told, View) or told.wish != self._wish:
                return
            kind = "settled" if told.settled else "near" if told.relaxed else "image"
            if np.isnan(getattr(self, kind)):
                setattr(self, kind, time.perf_counter() - self._asked)
                self.error = told.error
            self._there.notify_all()

    def wait(self, kind: str) -> float:
        with self._there:
            self._there.wait_for(lambda: not np.isnan(getattr(self, kind)), 300.0)
        return getattr(self, kind)


def wishes(rest: Wish, count: int) -> list[Wish]:
    """A slider that goes up a step at a time, from where a surgeon would begin."""
    apex = max((a for a in rest.correction if rest.fuses(a)), key=lambda a: rest.correction[a])
    steps = np.linspace(40, 40 + count, count, endpoint=False).astype(int) % 60 + 20
    return [replace(rest, correction={**rest.correction, apex: int(step)}) for step in steps]


def evaluation(patient: Patient) -> float:
    """Time of one evaluation of energy and gradient, the median of 20 [s]."""
    state, taken = patient.relaxer.state, []
    for _ in range(20):
        start = time.perf_counter()
        state.evaluate()
        state.read()
        taken.append(time.perf_counter() - start)
    return float(np.median(taken))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case")
    parser.add_argument("--wishes", type=int, default=30)
    parser.add_argument("--device", default="auto")
    parser.add_argument("--bones", choices=("follow", "spline"), default="follow")
    parser.add_argument("--tolerance", type=float, default=0.01, help="of the last relaxation [mm]")
    parser.add_argument("--minutes", type=float, default=0.0)
    parser.add_argument("--page", action="store_true")
    given = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    simulation = SimulationOptions(relax=RelaxOptions(tolerance=given.tolerance))
    options = RunOptions(bones=given.bones, device=given.device, simulation=simulation)
    patient = patient_of(read_case(given.case), options)
    unit = evaluation(patient)
    print(f"{len(patient.trunk.tets)} tetrahedra, {patient.model.device}; one evaluation {unit * 1e3:.2f} ms")
    rest = first_wish(spine_before(patient.case.landmarks_before))
    drag = wishes(rest, given.wishes)
    if given.page:
        over_the_wire(patient, drag, unit)
        return
    clock, faults = Clock(), []
    with Session(patient, None, clock, faults.append) as session:
        clock.ask(session, drag[0])
        clock.wait("settled")
        for kind in ("near", "settled"):
            image, there, start = [], [], time.perf_counter()
            for wish in drag[1:]:
                clock.ask(session, wish)
                there.append(clock.wait(kind))
                image.append(clock.image)
            rate = len(there) / (time.perf_counter() - start)
            for name, taken in (("image", image), (kind, there)):
                tell(name, taken, drag[1:], unit)
            print(f"{rate:.1f} updates a second")
        memory(session, drag, given.minutes)
    if faults:
        raise SystemExit(faults[0])


def tell(name: str, taken: list[float], drag: list[Wish], unit: float) -> None:
    """Prints the median of times [s], and the longest with the wish that it was for."""
    middle, worst = float(np.median(taken)), int(np.argmax(taken))
    print(
        f"{name}: {middle * 1e3:.0f} ms, {middle / unit:.1f} evaluations; at most {taken[worst] * 1e3:.0f} ms, "
        f"for wish {worst + 1} of {len(taken)}, {max(drag[worst].correction.values())} %"
    )


def over_the_wire(patient: Patient, drag: list[Wish], unit: float) -> None:
    """Drags the slider of a page by its websocket."""
    from live_client import Client  # here: it needs the extra `live`

    shares = [max(wish.correction.values()) for wish in drag]
    from warp_trunk.live.page import Page  # the extra, which nothing else here needs

    with TemporaryDirectory() as folder, Page(patient, Path(folder), free_port()) as page:
        with Client(page.server.address) as client:
            client.move(shares[0])
            start = time.perf_counter()
            taken = [client.move(share) for share in shares[1:]]
            rate = len(taken) / (time.perf_counter() - start)
        tell("image, over the websocket", [image for image, _ in taken], drag[1:], unit)
        tell("near, over the websocket", [near for _, near in taken], drag[1:], unit)
        print(f"{rate:.1f} updates a second")
        if page.failure:
            raise SystemExit(page.failure)


def memory(session: Session, drag: list[Wish], minutes: float) -> None:
    """Drags on and prints the memory of this process each minute."""
    process, start, said, count = psutil.Process(), time.monotonic(), 0, 0
    while time.monotonic() - start < 60.0 * minutes:
        session.ask(drag[count % len(drag)])
        count += 1
        time.sleep(EVERY)
        if time.monotonic() - start > 60.0 * said:
            print(f"minute {said}: {process.memory_info().rss / 1e6:.0f} MB after {count} wishes", flush=True)
            said += 1
    if minutes:
        print(f"end: {process.memory_info().rss / 1e6:.0f} MB after {count} wishes")


if __name__ == "__main__":
    main()

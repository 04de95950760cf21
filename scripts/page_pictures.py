"""Pictures of the report and of the planning page for README and docs/, drawn by Chromium as a reader sees them.

uv run python scripts/page_pictures.py report results/demo docs/report.png
uv run python scripts/page_pictures.py live cases/anna t4_l1.toml docs/live.png
"""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import tyro
from playwright.sync_api import Page as Tab
from playwright.sync_api import sync_playwright

from warp_trunk import Execution, RunOptions, read_case, read_result, write_report
from warp_trunk.bone_motion.plan import read_plan
from warp_trunk.live.planning_page import Page
from warp_trunk.live.sliders import SpineSliders
from warp_trunk.recording.viewer import free_port
from warp_trunk.run.patient import patient_of

WIDE, HIGH = 1280, 900
"""Of the window [pixels]."""
WAIT = 300_000.0
"""Longest wait for a skin that is relaxed to the end [ms]."""
WEBGL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-webgl", "--ignore-gpu-blocklist")


@contextmanager
def opened(address: str) -> Iterator[Tab]:
    """A tab with a page, drawn by the processor."""
    with sync_playwright() as playwright:
        program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))))
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox", *WEBGL])
        tab = browser.new_page(viewport={"width": WIDE, "height": HIGH})
        tab.set_default_timeout(WAIT)
        tab.goto(address)
        yield tab
        browser.close()


def draw_report(result: Path, out: Path) -> None:
    """The first screen of a report: backs, numbers and sentences."""
    with (
        tempfile.TemporaryDirectory() as folder,
        opened(write_report(read_result(result), folder).as_uri()) as tab,
    ):
        bottom = tab.evaluate("document.querySelector('.sentences').getBoundingClientRect().bottom + scrollY")
        tab.screenshot(path=out, full_page=True, clip={"x": 0.0, "y": 0.0, "width": WIDE, "height": bottom + 10.0})


def draw_live(case: Path, plan: Path, out: Path) -> None:
    """The planning page of a case at a plan, relaxed to the end."""
    patient = patient_of(read_case(case), RunOptions(), execution=Execution())
    sliders = SpineSliders(patient.case, read_plan(plan))
    with (
        tempfile.TemporaryDirectory() as folder,
        Page(patient, sliders, Path(folder), free_port()) as page,
        opened(page.server.address) as tab,
    ):
        tab.wait_for_function("document.body.innerText.includes('solved to')")
        tab.get_by_text("Software WebGL").wait_for()  # closed by a click
        tab.locator(".mantine-Notification-closeButton").first.dispatch_event("click")
        tab.wait_for_timeout(3000)
        tab.screenshot(path=out)


if __name__ == "__main__":
    commands = {"report": draw_report, "live": draw_live}
    tyro.extras.subcommand_cli_from_dict(commands, description=__doc__, config=(tyro.conf.PositionalRequiredArgs,))

"""A plugin of pytest for sample_mutants.py: coverage by test and by shared fixture, and the seconds of each."""

import json
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import coverage
import pytest

_tests: dict[str, tuple[float, list[str]]] = {}
_fixtures: dict[str, float] = {}
_current = [""]
"""The context, innermost last."""


def _switch() -> None:
    if measuring := coverage.Coverage.current():
        measuring.switch_context(_current[-1])


@contextmanager
def _within(context: str) -> Iterator[Callable[[], float]]:
    """Covers by a context; yields the seconds since then without those of shared fixtures."""
    inner, started = sum(_fixtures.values()), time.perf_counter()
    _current.append(context)
    _switch()
    try:
        yield lambda: time.perf_counter() - started - (sum(_fixtures.values()) - inner)
    finally:
        _current.pop()
        _switch()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: Any) -> Iterator[None]:
    with _within(item.nodeid) as alone:
        try:
            return (yield)
        finally:
            definitions = [chain[-1] for chain in item._fixtureinfo.name2fixturedefs.values()]
            shared = [_name(fixture) for fixture in definitions if fixture.scope != "function"]
            _tests[item.nodeid] = (round(alone(), 3), [name for name in shared if name in _fixtures])


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: Any) -> Iterator[Any]:
    if fixturedef.scope == "function":
        return (yield)
    name = _name(fixturedef)
    with _within(name) as alone:
        try:
            return (yield)
        finally:
            _fixtures[name] = round(_fixtures.get(name, 0.0) + alone(), 3)


def _name(fixturedef: Any) -> str:
    return f"fixture {fixturedef.baseid} {fixturedef.argname}"


def pytest_sessionfinish() -> None:
    text = json.dumps({"tests": _tests, "fixtures": _fixtures})
    Path(os.environ["MUTANT_SECONDS"]).write_text(text + "\n", encoding="utf-8", newline="\n")

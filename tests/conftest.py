"""Fixtures that tests of several rooms share. This folder is on the import path, for the package support in it."""

import os
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read by NumPy once; workers of a run share the cores already

import pytest

from support.report_results import write_small_result
from warp_trunk.report import write_report


@pytest.fixture(scope="session")
def plain_report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of a result without an actual skin, and with a name that is markup."""
    return write_report(
        write_small_result(tmp_path_factory.mktemp("plain"), name='<script>alert("x")</script> & Co')
    )


@pytest.fixture(scope="session")
def compared_report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of a result with an actual skin, turned 3 degrees further, and without the level T8."""
    return write_report(write_small_result(tmp_path_factory.mktemp("compared"), turn_more=3.0, without="T8"))

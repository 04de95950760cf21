"""Versions of this program and of the packages that its numbers come from."""

from __future__ import annotations

import platform
from importlib import metadata

PACKAGES = ("warp-trunk", "warp-lang", "numpy", "scipy", "tetgen", "trimesh", "rerun-sdk")


def versions() -> dict[str, str | None]:
    """Version by name; None for a package that is not installed."""
    found: dict[str, str | None] = {"python": platform.python_version(), "platform": platform.platform()}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = None
    return found

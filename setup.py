"""Which folders are packages; everything else about the project stands in pyproject.toml."""

from setuptools import find_packages, setup

setup(packages=[*find_packages(include=["warp_trunk*"]), "warp_trunk.kernels"])

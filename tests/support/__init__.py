"""Shared by tests of several packages: meshes and cases, independent references, viewers."""

"""The report of a result, or of plans side by side, for patient and surgeon: pictures, sentences and numbers."""

from .writing import write_comparison, write_report

__all__ = ["write_comparison", "write_report"]

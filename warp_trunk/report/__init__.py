"""The report of a result, for the patient and the surgeon: pictures, sentences and numbers."""

from .writing import write_report

__all__ = ["write_report"]

"""How a command ends, for the shell."""

OK, NOT_CONVERGED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
"""Exit statuses."""

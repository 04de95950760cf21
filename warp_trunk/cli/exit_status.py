"""How a command ends, for the shell."""

OK, NOT_CONVERGED, BAD_INPUT, INCOMPLETE, INTERRUPTED = 0, 1, 2, 3, 130
"""Exit statuses; INCOMPLETE where a command did what it could and named what it could not."""
NOT_READY = NOT_CONVERGED
"""Exit status of `doctor` if something essential is missing."""

"""The one error for bad input: its text names the file or argument, the rule, the value found and the cure."""


class InputError(ValueError):
    """Something given to the program breaks a stated rule; the command line ends with status 2."""

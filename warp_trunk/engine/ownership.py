"""Whose a relaxer is: its state, matrix and vectors serve one user at a time.

A user is a simulation, a linearization or one relaxation. Whoever takes the relaxer last has it. The one before is
refused when it goes on, as the tissue has moved. While a user is at work any other is refused, from `watch` and
from another thread. Users of different relaxers take turns (see `ENGINE`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

from warp_trunk.errors import InputError
from warp_trunk.kernels.starting import ENGINE

from .state import State

P = ParamSpec("P")
R = TypeVar("R")


class Ownership:
    """Which user has a relaxer, by a token that every use is checked against, and which is at work with it."""

    def __init__(self, state: State) -> None:
        """No one has it yet; `state` is the one that its users move."""
        self._state = state
        self._owner: object | None = None
        self._at_work: object | None = None
        self._version: int | None = None
        """That of the state after the owner's last use."""

    def take(self) -> object:
        """The token of a new user, who has the relaxer from now on; InputError while another is at work."""
        if self._at_work is not None:
            raise InputError(
                "relaxer: another simulation, relaxation or linearization is at work with it; wait for its end, "
                "or make a relaxer for each"
            )
        self._owner, self._version = object(), None
        return self._owner

    def work(self, user: object | None, function: Callable[P, R], *arguments: P.args, **named: P.kwargs) -> R:
        """Calls a function that uses the relaxer, in its turn.

        Args:
            user: the token of its user; None takes the relaxer for this call.
            function: the function.
            arguments: its arguments.
            named: its named arguments.

        Raises:
            InputError: another user is at work with it, or somebody has moved the tissue since the last use.
        """
        if user is None:
            user = self.take()
        with ENGINE:
            outer = self._at_work
            if self._owner is not user or (outer is None and self._version not in (None, self._state.version)):
                raise InputError(
                    "relaxer: another simulation, relaxation or linearization has used it since, and moved the "
                    "tissue; take one to its end before the next begins, or make a relaxer for each"
                )
            try:
                self._at_work = user
                return function(*arguments, **named)
            finally:
                self._at_work = outer
                self._version = self._state.version

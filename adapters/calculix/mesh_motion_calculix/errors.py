"""The errors of the adapter.

::

    CalculixError
    ├── DeckError      the deck, the set or the caller's arrays are wrong; nothing was run, or ccx refused the deck
    ├── DivergedError  the window has no solution that ccx found; the start of the window does not change
    └── RunError       ccx is missing, took too long or died; the folder belongs to another run
"""

from __future__ import annotations

__all__ = ["CalculixError", "DeckError", "DivergedError", "RunError"]


class CalculixError(Exception):
    """Base of the adapter's errors.

    Parameters
    ----------
    message : str
        One line: what was expected, what came.
    hint : str, optional
        What to do.
    """

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(f"{message} ({hint})" if hint else message)
        self.message = message
        self.hint = hint


class DeckError(CalculixError):
    """The deck, the interface set or the caller's arrays are wrong."""


class DivergedError(CalculixError):
    """The window's equations were not solved; with a smaller load or window they may be."""


class RunError(CalculixError):
    """The program could not be run to its end, or the folder cannot be used."""

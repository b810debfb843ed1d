"""CalculiX as the solid of a coupled computation: one run of ``ccx`` for each time window, with restart files.

::

    errors   the errors, each with a hint what to do
    deck     the user's input deck: nodes, node sets, what it may not contain
    window   one window: its deck, the run of ccx, what ccx printed
    solid    the participant: solve, advance, resume
    flap     the deck of a clamped flap, to start with
"""

from mesh_motion_calculix.deck import Deck, read_deck
from mesh_motion_calculix.errors import CalculixError, DeckError, DivergedError, RunError
from mesh_motion_calculix.flap import flap_deck
from mesh_motion_calculix.solid import Solid
from mesh_motion_calculix.window import Options

__all__ = [
    "CalculixError",
    "Deck",
    "DeckError",
    "DivergedError",
    "Options",
    "RunError",
    "Solid",
    "flap_deck",
    "read_deck",
]

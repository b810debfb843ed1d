"""Named points where a proof makes the server fail: by a kill, an error or a delay.

``failpoint("journal.commit.slot-synced")`` stands where a crash, an error or a delay would hurt most; without
:data:`VARIABLE` in the environment of the process it does nothing. The variable names a folder of the operator's own
(0700) with a plan of what happens where; nothing that comes over a socket reaches it. What happens at a point is not
part of the package: ``proofs/failpoint_plan.py`` of a checkout does it.
"""

import os
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path

from mesh_motion_protocol.errors import InvalidInput

__all__ = ["VARIABLE", "activate", "deactivate", "failpoint"]

#: Environment variable with the folder of plan and counts.
VARIABLE = "MESH_MOTION_FAILPOINTS"
_PLAN = "proofs.failpoint_plan"

#: What is called at each point, if anything.
_PASSED: list[Callable[[str], None]] = []


def failpoint(name: str) -> None:
    """A point that a plan may name; nothing happens unless :func:`activate` was called."""
    if _PASSED:
        _PASSED[0](name)


def activate(environment: Mapping[str, str] = os.environ) -> Path | None:
    """Take the folder that the environment names, if any; called first in each process of the server.

    Raises
    ------
    InvalidInput
        If the folder is not a folder of this user, its plan is invalid, or this is no checkout.
    """
    named = environment.get(VARIABLE)
    if not named:
        return None
    try:
        plan = import_module(_PLAN)
    except ModuleNotFoundError:
        raise InvalidInput(f"{VARIABLE}: only a checkout, with its proofs, has failpoints") from None
    folder = Path(named)
    _PASSED[:] = [plan.of_folder(folder)]
    return folder


def deactivate() -> None:
    """Disable all points in this process."""
    _PASSED.clear()

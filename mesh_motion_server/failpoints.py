"""Named points where a test makes the server fail: by a kill, an error or a delay.

``failpoint("journal.commit.slot-synced")`` is called where a crash, an error or a delay would do most harm; without
:data:`VARIABLE` in the environment of the process it does nothing. The variable names a folder of the operator (0700)
with a plan: the points, and the action at each. No data from a socket can change it. The actions are not part of the
package: they are in ``tests/faults/failpoint_plan.py`` of a checkout.
"""

import os
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path

from mesh_motion_protocol.errors import InvalidInput

#: Environment variable with the folder of the plan and of the counts.
VARIABLE = "MESH_MOTION_FAILPOINTS"
_PLAN = "tests.faults.failpoint_plan"

#: Function that is called at each point; None: no call.
_PASSED: list[Callable[[str], None]] = []


def failpoint(name: str) -> None:
    """A point that a plan may name; does nothing unless :func:`activate` was called."""
    if _PASSED:
        _PASSED[0](name)


def activate(environment: Mapping[str, str] = os.environ) -> Path | None:
    """Take the folder that the environment names, if any; called first in each process of the server.

    Raises InvalidInput if the folder is not a folder of this user, its plan is invalid, or this is not a checkout.
    """
    named = environment.get(VARIABLE)
    if not named:
        return None
    try:
        plan = import_module(_PLAN)
    except ModuleNotFoundError:
        raise InvalidInput(f"{VARIABLE}: failpoints exist only in a checkout with its tests") from None
    folder = Path(named)
    _PASSED[:] = [plan.of_folder(folder)]
    return folder


def deactivate() -> None:
    """Disable all points in this process."""
    _PASSED.clear()

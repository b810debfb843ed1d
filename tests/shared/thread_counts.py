"""Loops on one thread and on several."""

from collections.abc import Callable
from typing import Any

from mesh_motion_numerics.threads import limited_to


def on_one_and_on_all_threads(make: Callable[[], Any]) -> list[Any]:
    found = []
    for limit in (1, None):
        with limited_to(limit):
            found.append(make())
    return found

"""Actions of a driver, its rivals, time and accidents on a session, as words that can be written down and repeated.

``MOVE/1/step/3``: partition 1 sends a MOVE with a twist, here a wrong step; 3 chooses the details; ``*`` stands for all
partitions, one after the other. Except for the twist, the fields of a request fit the session.
"""

from typing import NamedTuple

ALL = -1
_ROLES = ("stranger", "monitor", "admin", "unlisted")
_DATA = ("", "epoch", "session", "partition", "unjoined", *_ROLES)
_ONCE = (*_DATA, "again", "other")
#: Request → what may be special about it.
TWISTS: dict[str, tuple[str, ...]] = {
    "OPEN": ("", "disk", "monitor", "admin", "unlisted"),
    "RESUME": ("", "again", "other", "token", "host", "disk", *_ROLES),
    "PROBE": ("", "token", *_ROLES),
    "LIST": ("", *_ROLES),
    "JOIN": ("", "token", "epoch", "session", "partition", *_ROLES),
    "UPLOAD": (*_ONCE, "rows"),
    "BUILD": (*_ONCE, "disk", "crash", "power"),
    "MOVE": (*_ONCE, "step", "rows", "far", "reference"),
    "COMMIT": (*_ONCE, "step", "disk", "crash", "power", "defect", "inside"),
    "ROLLBACK": (*_ONCE, "step"),
    "FETCH": (*_DATA, "reference"),
    "STATUS": _DATA,
    "CLOSE": (*_DATA, "discard"),
}
REQUESTS = tuple(TWISTS)
#: Events without a request: the lease's end, a killed worker, a power cut, a planned restart, a disk that takes
#: nothing until it is healed, time, a partition's connection made again, and a slow disk, which shows where a session
#: does not wait for it.
EVENTS = ("LEASE_END", "CRASH", "POWER", "STOP", "BREAK", "HEAL", "WAIT", "RECONNECT", "STALL")


class Action(NamedTuple):
    """One action: its name, its partition, its twist, and a number that chooses the details."""

    operation: str
    partition: int = 0
    twist: str = ""
    value: int = 0

    def __str__(self) -> str:
        partition = "*" if self.partition == ALL else str(self.partition)
        return "/".join((self.operation, partition, self.twist, str(self.value)))


def story(actions: list[Action]) -> str:
    return " ".join(map(str, actions))


def read_story(text: str) -> list[Action]:
    parts = [word.split("/") for word in text.split()]
    return [Action(what, ALL if p == "*" else int(p), twist, int(value)) for what, p, twist, value in parts]

"""Section 10 of SPEC.md as a list: a client's requests in the order in which they were last answered."""

from dataclasses import dataclass, field
from typing import Any


@dataclass
class Entry:
    """A request that was answered.

    ``executed``: if False, it was refused, and a repeat is tried again; ``known``: if False (COMMITs only), the server
    was restarted since and has forgotten it; ``type``, ``fields``, ``reply`` (str, dict, Message or None): of the
    reply; its fields are known before, the whole reply after it came.
    """

    sequence: int
    content: Any
    executed: bool
    kind: str
    type: str = ""
    fields: dict[str, Any] = field(default_factory=dict)
    reply: Any = None
    known: bool = True
    asked: Any = None

    def keep(self, reply: Any) -> None:
        self.reply = reply


class Book:
    """One client's requests.

    ``kept``: number of replies that the server keeps.
    """

    def __init__(self, kept: int) -> None:
        self._kept = kept
        self.entries: list[Entry] = []

    def enter(self, entry: Entry, asked: Any) -> None:
        entry.asked = asked
        self.entries = [other for other in self.entries if other.sequence != entry.sequence]
        self.entries.append(entry)

    def restart(self) -> None:
        """Forget everything that is not durable."""
        for entry in self.entries:
            entry.known = entry.known and entry.executed and entry.kind == "COMMIT"

    def forget_steps_after(self, step: int) -> None:
        for entry in self.entries:
            entry.known = entry.known and entry.fields.get("step", 0) <= step

    def verdict(self, sequence: int, content: Any) -> Entry | str:
        """The entry with the expected reply, the code of a refusal, or ``""`` to execute the request."""
        entry = next((entry for entry in self.entries if entry.sequence == sequence), None)
        if entry is None:
            return ""
        later = self._later(entry)
        if entry.known and len(later) < self._kept:
            if entry.content != content:
                return "ABORTED.CONFLICT"
            return entry if entry.executed else ""
        return "ABORTED.STALE" if self._surely_dropped(entry) else ""

    def _later(self, entry: Entry) -> list[Entry]:
        """Replies of the server since then that it remembers."""
        return [other for other in self.entries[self.entries.index(entry) + 1 :] if other.known]

    def _surely_dropped(self, entry: Entry) -> bool:
        later = [other for other in self._later(entry) if other.executed and other.sequence > entry.sequence]
        return len(later) >= self._kept + (not entry.known)

    def is_clear(self, entry: Entry) -> bool:
        """Whether SPEC.md allows only one answer to a repeat; it leaves open whether refused requests count as kept."""
        if entry.known:
            return len(self._later(entry)) < self._kept or self._surely_dropped(entry)
        return sum(other.known for other in self.entries) <= self._kept or self._surely_dropped(entry)

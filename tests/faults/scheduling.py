"""How long a process had to wait for a processor, from Linux' scheduler: what a time was measured under."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Turns:
    """What a process' main thread had of the processors.

    ``ran``, ``waited``: seconds on a processor, and ready to run without one; ``count``: how often it got one.
    """

    ran: float
    waited: float
    count: int

    def since(self, earlier: Turns) -> dict[str, float]:
        """Turns since then, and the milliseconds of each on average."""
        turns = max(1, self.count - earlier.count)
        ran, waited = 1000 * (self.ran - earlier.ran), 1000 * (self.waited - earlier.waited)
        return {"turns": float(turns), "ran_ms": ran / turns, "waited_ms": waited / turns}


def turns_of(pid: int) -> Turns:
    """Since the process was started; all 0 where the kernel does not count."""
    try:
        ran, waited, count = Path(f"/proc/{pid}/schedstat").read_text(encoding="ascii").split()
    except OSError:
        return Turns(0.0, 0.0, 0)
    return Turns(int(ran) / 1e9, int(waited) / 1e9, int(count))

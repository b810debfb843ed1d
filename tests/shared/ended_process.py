"""A process that is over, as its parent has it."""

from __future__ import annotations


class EndedProcess:
    """What takes the place of a subprocess.Popen; counts how often it was killed."""

    pid = 2**22

    def __init__(self) -> None:
        self.killed = 0

    def kill(self) -> None:
        """See subprocess.Popen."""
        self.killed += 1

    def wait(self, timeout: float | None = None) -> int:
        """See subprocess.Popen."""
        return 0

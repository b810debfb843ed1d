"""Children of the supervisor: how they start, what bounds them, and that they never outlive it."""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
import signal
import socket
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.transport.channel import Channel

__all__ = [
    "Child",
    "die_with_parent",
    "limit_address_space",
    "limit_descriptors",
    "offer_to_the_oom_killer",
    "spawn",
    "wake_on_signals",
]

_PR_SET_PDEATHSIG = 1
#: A child ends within this once its line is closed, and once more after SIGKILL, seconds.
_END_SECONDS = 5.0
#: Of -1000 … 1000; 0 is usual.
_OOM_SCORE = 500


@dataclass(eq=False)
class Child:
    """A child process and the line to it."""

    process: subprocess.Popen[bytes]
    channel: Channel
    spoke: bool = False  # it has got as far as saying something

    @property
    def pid(self) -> int:
        """Process id."""
        return self.process.pid

    def kill(self) -> None:
        """End it at once; its channel then reads as closed."""
        self.process.kill()

    def exit_descriptor(self) -> int | None:
        """A descriptor that becomes readable when it has ended; None where the system has none."""
        try:
            return os.pidfd_open(self.pid)
        except (AttributeError, OSError):
            return None

    def reap(self) -> int:
        """Collect the exit status of a child that has ended or is about to; finite whatever it does."""
        self.channel.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            return self.process.wait(timeout=_END_SECONDS)
        self.process.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            return self.process.wait(timeout=_END_SECONDS)
        return -signal.SIGKILL  # the kernel does not let it go: it waits for a disk that does not answer


def spawn(module: str, *arguments: str, threads: int = 0) -> Child:
    """Start ``python -m module CHANNEL arguments…``.

    BLAS gets one thread: its sums are then repeatable bit for bit. The compiled loops have threads of
    their own, which sleep while they wait: beside a solver that uses every core, spinning threads take three times as
    long.
    """
    failpoint("supervisor.spawn")
    channel, theirs = Channel.pair()
    with theirs:
        process = subprocess.Popen(
            [sys.executable, "-m", module, str(theirs.fileno()), *arguments],
            pass_fds=[theirs.fileno()],
            env=os.environ | _thread_settings(threads),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )
    return Child(process, channel)


def _thread_settings(threads: int) -> dict[str, str]:
    single = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "OMP_NUM_THREADS")
    return dict.fromkeys(single, "1") | {"MESH_MOTION_THREADS": str(threads or len(os.sched_getaffinity(0)))}


def die_with_parent() -> None:
    """Called first in a child: the kernel kills it when the supervisor dies, however that dies.

    Elsewhere than on Linux the closed channel tells, once the current request is done. The terminal's Ctrl-C is the
    supervisor's matter.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)


def limit_address_space(allowance: int) -> None:
    """Bound the address space to what is mapped now plus ``allowance`` bytes.

    Only this stops frames that announce MORE for ever: MAXMSGSIZE and the high-water marks do not count them.
    """
    mapped = _mapped_bytes()
    if mapped:
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        limit = mapped + allowance
        resource.setrlimit(resource.RLIMIT_AS, (limit if hard < 0 else min(limit, hard), hard))


def offer_to_the_oom_killer() -> None:
    """When the machine's memory is full, this process goes first: it can be replaced, its parent cannot."""
    with contextlib.suppress(OSError, ValueError):
        score = Path("/proc/self/oom_score_adj")
        score.write_text(str(max(_OOM_SCORE, int(score.read_text()))), encoding="ascii")


def limit_descriptors(count: int) -> None:
    """Bound the open files and connections; further connections then wait until some have ended."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    limit = count if hard < 0 else min(count, hard)
    resource.setrlimit(resource.RLIMIT_NOFILE, (limit, limit))


def _mapped_bytes() -> int:
    """Address space in use, 0 where the system does not tell."""
    try:
        with open("/proc/self/statm", encoding="ascii") as statm:
            return int(statm.read().split()[0]) * resource.getpagesize()
    except OSError:
        return 0


def wake_on_signals(*signals: signal.Signals) -> socket.socket:
    """A socket that becomes readable with one byte, its number, for each of these signals."""
    reader, writer = socket.socketpair()
    for end in (reader, writer):
        end.setblocking(False)
    _writers.append(writer)
    for number in signals:
        signal.signal(number, lambda *_: None)
    signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    return reader


#: Writing ends stay open as long as the process.
_writers: list[socket.socket] = []

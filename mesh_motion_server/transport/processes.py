"""Children of the supervisor: how they start, what bounds them, and that they never outlive it.

Workers are forked from one process that has imported everything, the template: a session then starts in
milliseconds, and what is imported is in memory once.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
import signal
import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.transport.channel import Channel

__all__ = [
    "Child",
    "Forked",
    "adopt_orphans",
    "die_with_parent",
    "fork",
    "fork_from_template",
    "limit_address_space",
    "limit_descriptors",
    "offer_to_the_oom_killer",
    "spawn",
    "wake_on_signals",
]

_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36
#: A child ends within this once its line is closed, and once more after SIGKILL, seconds.
_END_SECONDS = 5.0
#: Of -1000 … 1000; 0 is usual.
_OOM_SCORE = 500


class Forked:
    """What is used of :class:`subprocess.Popen`, for a child that the template has forked.

    Parameters
    ----------
    template : Child

    Attributes
    ----------
    pid : int
        0 until the child has told it.
    """

    def __init__(self, template: Child) -> None:
        self.pid = 0
        self._template = template

    def kill(self) -> None:
        """End it at once; of one that has told no pid the template, which does not come to fork it."""
        if self.pid:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)
        else:
            self._template.kill()

    def wait(self, timeout: float) -> int:
        """The exit status; 1 for one that was never forked.

        Raises
        ------
        subprocess.TimeoutExpired
        """
        deadline = time.monotonic() + timeout
        while self.pid:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                return os.waitstatus_to_exitcode(status)
            if time.monotonic() >= deadline:
                raise subprocess.TimeoutExpired("worker", timeout)
            time.sleep(0.001)
        return 1


@dataclass(eq=False)
class Child:
    """A child process and the line to it."""

    process: subprocess.Popen[bytes] | Forked
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


def fork(template: Child) -> Child:
    """Have the template fork a child once it has imported everything; if it is gone, the line reads as closed."""
    failpoint("supervisor.fork")
    channel, theirs = Channel.pair()
    with theirs:
        template.channel.hand_over(theirs)
    return Child(Forked(template), channel)


def fork_from_template() -> bool:
    """Fork a child of this process' parent; True in the child.

    The process between the two ends at once, so that its child goes to the supervisor (:func:`adopt_orphans`), which
    alone collects exit statuses.

    Raises
    ------
    OSError
        If the system refuses.
    """
    failpoint("template.fork")
    supervisor = os.getppid()
    between = os.fork()
    if between:
        refusal = os.waitstatus_to_exitcode(os.waitpid(between, 0)[1])
        if refusal > 0:
            raise OSError(refusal, os.strerror(refusal))
        return False
    between = os.getpid()
    try:
        child = os.fork()
    except OSError as error:
        os._exit(error.errno or 1)
    if child:
        os._exit(0)
    while os.getppid() == between:
        time.sleep(1e-4)
    die_with_parent()
    if os.getppid() != supervisor:
        os._exit(0)  # it died before it could be told that its death is this child's
    return True


def adopt_orphans() -> None:
    """Make this process the parent of what its children leave behind."""
    _prctl(_PR_SET_CHILD_SUBREAPER, 1)


def _prctl(option: int, value: int) -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(option, value, 0, 0, 0)


def _thread_settings(threads: int) -> dict[str, str]:
    single = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "OMP_NUM_THREADS")
    return dict.fromkeys(single, "1") | {"MESH_MOTION_THREADS": str(threads or len(os.sched_getaffinity(0)))}


def die_with_parent() -> None:
    """Called first in a child: the kernel kills it when the supervisor dies, however that dies.

    Elsewhere than on Linux the closed channel tells, once the current request is done. The terminal's Ctrl-C is the
    supervisor's matter.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


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

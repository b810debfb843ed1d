"""Children of the supervisor: how they start, what bounds them, and that they never outlive it.

All of them are forked from the supervisor, and workers from one that has imported everything since, the template: a
server is up in a third of a second, a session in milliseconds, and what is imported is in memory once.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import os
import resource
import signal
import socket
import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.operation.tally import TALLY
from mesh_motion_server.transport.channel import Channel

__all__ = [
    "Attempts",
    "Child",
    "adopt_orphans",
    "fork",
    "fork_from_template",
    "limit_address_space",
    "limit_descriptors",
    "name_process",
    "offer_to_the_oom_killer",
    "spawn",
    "use_one_blas_thread",
    "wake_on_signals",
]

_PR_SET_PDEATHSIG = 1
_PR_SET_NAME = 15
_PR_SET_CHILD_SUBREAPER = 36
#: A child ends within this once its line is closed, and once more after SIGKILL, seconds.
_END_SECONDS = 5.0
#: Of -1000 … 1000; 0 is usual.
_OOM_SCORE = 500
#: Starts of one child are counted over this, seconds.
_COUNTED_SECONDS = 3600.0


@dataclass(eq=False)
class Child:
    """A child process and the line to it.

    Attributes
    ----------
    pid : int
        Process id; 0 until a child that the template forks has told it.
    channel : Channel
    template : Child, optional
        Who forks it, if not the supervisor.
    spoke : bool
        It has got as far as saying something.
    """

    pid: int
    channel: Channel
    template: Child | None = None
    spoke: bool = False

    def kill(self) -> None:
        """End it at once; its channel then reads as closed.

        Of one that has told no pid the template is killed, which then does not come to fork it.
        """
        if self.pid:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)
        elif self.template is not None:
            self.template.kill()

    def exit_descriptor(self) -> int | None:
        """A descriptor that becomes readable when it has ended; None where the system has none."""
        try:
            return os.pidfd_open(self.pid)
        except (AttributeError, OSError):
            return None

    def reap(self) -> int:
        """Collect the exit status of a child that has ended or is about to; finite whatever it does."""
        self.channel.close()
        code = self._status()
        if code is None:
            self.kill()
            code = self._status()
        # the kernel may not let it go: it waits for a disk that does not answer
        return -signal.SIGKILL if code is None else code

    def _status(self) -> int | None:
        """The exit status, within some seconds; 1 of one that was never forked."""
        deadline = time.monotonic() + _END_SECONDS
        while self.pid:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                return os.waitstatus_to_exitcode(status)
            if time.monotonic() >= deadline:
                return None
            time.sleep(0.001)
        return 1


class Attempts:
    """Starts of a child that may fall: so many an hour, however long the server runs.

    Parameters
    ----------
    most : int
        Within an hour; a child that falls more often has a reason that another start does not cure.
    """

    def __init__(self, most: int) -> None:
        self._made: deque[float] = deque(maxlen=most)

    def note(self, now: float) -> None:
        """One more, at this time of the monotonic clock."""
        self._made.append(now)

    def over(self, now: float) -> bool:
        """Whether there is none left."""
        return len(self._made) == self._made.maxlen and now - self._made[0] < _COUNTED_SECONDS


def spawn(module: str, *arguments: str, threads: int = 1, anew: bool = False) -> Child:
    """Fork a child that calls ``main(channel, *arguments)`` of a module: what is imported here it need not import.

    One that is started ``anew``, as ``python -m module DESCRIPTOR arguments…``, has nothing of the supervisor's memory.

    The compiled loops of the child have threads of their own, which sleep while they wait: beside a solver that uses
    every core, spinning threads take three times as long. No zmq context may exist here, and no thread that holds a
    lock which a child wants.

    Raises
    ------
    OSError
        If the system refuses.
    """
    failpoint("supervisor.spawn")
    channel, line = Channel.pair()
    supervisor = os.getpid()

    def live() -> int:
        _begin(supervisor, line.fileno())
        os.environ["MESH_MOTION_THREADS"] = str(threads or len(os.sched_getaffinity(0)))
        if anew:
            line.set_inheritable(True)
            os.execv(sys.executable, [sys.executable, "-m", module, str(line.fileno()), *arguments])
        status: int = importlib.import_module(module).main(Channel(line), *arguments)
        return status

    with line:
        # a signal between the fork and the child's own handlers would be told to the supervisor
        before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGTERM, signal.SIGINT))
        try:
            pid = os.fork()
            if not pid:
                _end_with(live)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return Child(pid, channel)


def _begin(supervisor: int, line: int) -> None:
    """Leave what is the supervisor's: its death is this process' death, its files and counts are not this process'."""
    gc.freeze()  # what is collected later would close descriptors that are others' by then
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    _die_with(supervisor)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGTERM, signal.SIGINT))
    null = os.open(os.devnull, os.O_RDWR)
    os.dup2(null, 0)
    os.dup2(null, 1)
    for descriptor in map(int, os.listdir("/dev/fd")):
        if descriptor > 2 and descriptor != line:
            with contextlib.suppress(OSError):  # the listing's own
                os.close(descriptor)
    TALLY.take()
    use_one_blas_thread()


def _end_with(live: Callable[[], int]) -> NoReturn:
    """In the child: nothing of what the supervisor does at its end is done."""
    status = 1
    try:
        status = live()
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        os._exit(status)


# CPython maps 16 KiB for frames and unmaps them whenever a call crosses their end: imports so deep in the stack did it
# 12 000 times, a quarter of a second. Behind a frame that needs more than that, there is room for all calls.
_end_with.__code__ = _end_with.__code__.replace(co_stacksize=1 << 16)


def use_one_blas_thread() -> None:
    """For what is imported from now on: BLAS' sums are then repeatable bit for bit. Before numpy is imported."""
    names = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "OMP_NUM_THREADS")
    os.environ.update(dict.fromkeys(names, "1"))


def fork(template: Child) -> Child:
    """Have the template fork a child once it has imported everything; if it is gone, the line reads as closed."""
    failpoint("supervisor.fork")
    channel, theirs = Channel.pair()
    with theirs:
        template.channel.hand_over(theirs)
    return Child(0, channel, template)


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
    _die_with(supervisor)
    return True


def adopt_orphans() -> None:
    """Make this process the parent of what its children leave behind."""
    _prctl(_PR_SET_CHILD_SUBREAPER, 1)


def _prctl(option: int, value: int | bytes) -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(option, value, 0, 0, 0)


def name_process(role: str) -> None:
    """What ``ps -e`` and ``top`` call this process."""
    _prctl(_PR_SET_NAME, f"mesh-{role}".encode())


def _die_with(parent: int) -> None:
    """The kernel kills this process when its parent dies, however that dies.

    Elsewhere than on Linux the closed channel tells, once the current request is done. The terminal's Ctrl-C is the
    supervisor's matter.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(0)  # it died before it could be told that its death is this process'


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

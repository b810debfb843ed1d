"""Children of the supervisor: their start, their limits, and their end with the supervisor.

All are forked from the supervisor, workers through the template, a child that has imported everything. So a server
starts in a third of a second and a session in milliseconds, and imported modules are in memory only once.
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
import warnings
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.operation.tally import TALLY
from mesh_motion_server.transport.channel import Channel

#: Constants of Linux' sys/prctl.h and of glibc's malloc.h, for which Python has no names.
_PR_SET_PDEATHSIG = 1
_PR_SET_NAME = 15
_PR_SET_CHILD_SUBREAPER = 36
_M_ARENA_MAX = -8
_STOP = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
#: A child must end within this time after its line is closed, and again after SIGKILL, seconds.
_END_SECONDS = 5.0
#: Priority for the kernel's OOM killer, from -1000 to 1000; 0 is usual.
_OOM_SCORE = 500
#: NumPy's names for these features, before version 2.4 and since; it skips names that it does not know.
_AVX512 = "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR X86_V4"
#: Starts of one child are counted over this period, seconds.
_COUNTED_SECONDS = 3600.0


@dataclass(eq=False)
class Child:
    """A child process and the line to it."""

    pid: int  # process id; 0 until a child forked by the template has reported it
    channel: Channel
    template: Child | None = None  # the process that forks it, if not the supervisor
    spoke: bool = False  # whether it has sent a message

    def kill(self) -> None:
        """Kill the child at once; its channel then reads as closed.

        If it has not reported its pid, the template is killed, so that it does not fork the child.
        """
        if self.pid:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)
        elif self.template is not None:
            self.template.kill()

    def exit_descriptor(self) -> int | None:
        """Return a descriptor that becomes readable when the child has ended; None if the system has none."""
        try:
            return os.pidfd_open(self.pid)
        except (AttributeError, OSError):
            return None

    def reap(self) -> int:
        """Collect the exit status of a child that has ended or is about to; returns in bounded time."""
        self.channel.close()
        code = self._status()
        if code is None:
            self.kill()
            code = self._status()
        # the kernel may not end it while it waits for a disk that does not answer
        return -signal.SIGKILL if code is None else code

    def _status(self) -> int | None:
        """Return the exit status within some seconds; 1 for a child that was never forked."""
        deadline = time.monotonic() + _END_SECONDS
        while self.pid:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                return os.waitstatus_to_exitcode(status)
            if time.monotonic() >= deadline:
                return None
            time.sleep(0.001)  # waitpid itself has no time limit
        return 1


class Attempts:
    """Limits the starts of a child per hour.

    Parameters
    ----------
    most : int
        Largest number within an hour; a child that fails more often has a cause that a restart does not remove.
    """

    def __init__(self, most: int) -> None:
        self._made: deque[float] = deque(maxlen=most)

    def note(self, now: float) -> None:
        """Record one more start at this time of the monotonic clock."""
        self._made.append(now)

    def over(self, now: float) -> bool:
        """Whether the limit is reached."""
        return len(self._made) == self._made.maxlen and now - self._made[0] < _COUNTED_SECONDS


def spawn(module: str, *arguments: str, threads: int = 1, fresh: bool = False) -> Child:
    """Fork a child that calls ``main(channel, *arguments)`` of a module; modules of this process are already imported.

    With ``fresh`` the child starts as ``python -m module DESCRIPTOR arguments…``, without the supervisor's memory.

    The compiled loops of the child have their own threads, which sleep while they wait: while a solver uses every core,
    spinning threads take three times as long. This process must have no zmq context, and no thread that holds a lock
    which the child needs. Raises OSError if the system refuses the fork.
    """
    failpoint("supervisor.spawn")
    channel, line = Channel.pair()
    supervisor = os.getpid()

    def live() -> int:
        _begin(supervisor, line.fileno())
        os.environ["MESH_MOTION_THREADS"] = str(threads or len(os.sched_getaffinity(0)))
        if fresh:
            line.set_inheritable(True)
            os.execv(sys.executable, [sys.executable, "-m", module, str(line.fileno()), *arguments])
        status: int = importlib.import_module(module).main(Channel(line), *arguments)
        return status

    with line:
        # a signal between the fork and the child's own handlers would reach the supervisor
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _STOP)
        try:
            pid = os.fork()
            if not pid:
                _end_with(live)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return Child(pid, channel)


def _begin(supervisor: int, line: int) -> None:
    """Detach from the supervisor's files and counts; end when the supervisor ends."""
    gc.freeze()  # a later collection would close descriptors that other objects use by then
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    _die_with(supervisor)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _STOP)
    null = os.open(os.devnull, os.O_RDWR)
    os.dup2(null, 0)
    os.dup2(null, 1)
    os.closerange(3, line)
    os.closerange(line + 1, os.sysconf("SC_OPEN_MAX"))
    TALLY.take()
    _use_one_heap()
    use_repeatable_libraries()


def _end_with(live: Callable[[], int]) -> NoReturn:
    """Run the child and end it; the exit functions of the supervisor do not run in it."""
    status = 1
    try:
        status = live()
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        os._exit(status)


# CPython maps 16 KiB for frames and unmaps them when calls cross their end: deep imports did this 12 000 times, which
# took a quarter of a second. A frame that needs more than 16 KiB leaves room for all further calls.
_end_with.__code__ = _end_with.__code__.replace(co_stacksize=1 << 16)


def repeatable_libraries() -> dict[str, str]:
    """Environment in which BLAS and NumPy give the same bits on any number of threads and on any processor with AVX2.

    Both choose their code by the processor, and sums and logarithms of different code differ in the last bit. So
    OpenBLAS, which is in the wheels of NumPy and SciPy, is set to its code for AVX2, and NumPy's code for AVX-512 is
    disabled. A steady step takes no longer.
    """
    names = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "OMP_NUM_THREADS")
    threads = dict.fromkeys(names, "1")
    code = {"OPENBLAS_CORETYPE": "Haswell", "NPY_DISABLE_CPU_FEATURES": _AVX512}
    return threads | code if _has_avx2() else threads


def use_repeatable_libraries() -> None:
    """Set this environment in this process; call it before numpy is imported.

    NumPy warns about names that it does not know, and does not start if warnings are errors.
    """
    os.environ.update(repeatable_libraries())
    warnings.filterwarnings("ignore", "During parsing environment variable: 'NPY_DISABLE", ImportWarning)


def _has_avx2() -> bool:
    """Whether the first processor has AVX2, according to Linux.

    The compiled loops know it too, but loading them starts threads.
    """
    with contextlib.suppress(OSError), open("/proc/cpuinfo", encoding="latin-1") as lines:
        return any(line.startswith("flags") and {"avx2", "fma"} <= set(line.split()) for line in lines)
    return False


def fork(template: Child) -> Child:
    """Let the template fork a child after its imports; if the template is gone, the line reads as closed."""
    failpoint("supervisor.fork")
    channel, theirs = Channel.pair()
    with theirs:
        template.channel.hand_over(theirs)
    return Child(0, channel, template)


def fork_from_template() -> bool:
    """Fork a child of this process' parent; return True in the child.

    The process between the two ends at once, so that the supervisor (:func:`adopt_orphans`) becomes the parent of the
    child. Only the supervisor collects exit statuses. Raises OSError if the system refuses.
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
    while os.getppid() == between:  # only then the supervisor is the parent, whose death the kernel watches
        time.sleep(1e-4)
    _die_with(supervisor)
    return True


def adopt_orphans() -> None:
    """Make this process the parent of the processes that its children leave behind."""
    _prctl(_PR_SET_CHILD_SUBREAPER, 1)


def _prctl(option: int, value: int | bytes) -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(option, value, 0, 0, 0)


def name_process(role: str) -> None:
    """Set the name that ``ps -e`` and ``top`` show for this process."""
    _prctl(_PR_SET_NAME, f"mesh-{role}".encode())


def _die_with(parent: int) -> None:
    """Let the kernel kill this process when its parent dies for any reason.

    On systems other than Linux the closed channel ends it after the current request. Ctrl-C in the terminal, and the
    end of the terminal, are left to the supervisor.
    """
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(0)  # the parent died before the call above took effect


def limit_address_space(allowance: int) -> None:
    """Bound the address space to its present size plus ``allowance`` bytes.

    No other limit stops a message with endless frames (flag MORE): MAXMSGSIZE and the high-water marks do not count
    frames.
    """
    mapped = _mapped_bytes()
    if mapped:
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        limit = mapped + allowance
        resource.setrlimit(resource.RLIMIT_AS, (limit if hard < 0 else min(limit, hard), hard))


def _use_one_heap() -> None:
    """Let all threads use the heap of the first thread; call this before any other thread starts.

    glibc gives each thread a heap, and keeps the heap's addresses when its memory is freed. After a connection that
    sent frames up to the limit of the address space, no addresses were left.
    """
    set_option = getattr(ctypes.CDLL(None), "mallopt", None)  # other C libraries have no heaps for threads
    if set_option is not None:
        set_option(_M_ARENA_MAX, 1)


def return_memory() -> None:
    """Return freed memory that the C library keeps to the system.

    glibc keeps small pieces for later, for example half a gigabyte of frames from a connection that was then closed.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # other C libraries do not have it
    if trim is not None:
        trim(0)


def offer_to_the_oom_killer() -> None:
    """Let the kernel end this process first when the memory is full: it can be replaced, its parent cannot."""
    with contextlib.suppress(OSError, ValueError):
        score = Path("/proc/self/oom_score_adj")
        score.write_text(str(max(_OOM_SCORE, int(score.read_text()))), encoding="ascii")


def limit_descriptors(count: int) -> None:
    """Bound the open files and connections; further connections then wait until some have ended."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    limit = count if hard < 0 else min(count, hard)
    resource.setrlimit(resource.RLIMIT_NOFILE, (limit, limit))


def _mapped_bytes() -> int:
    """Return the address space in use, 0 if the system does not report it."""
    try:
        with open("/proc/self/statm", encoding="ascii") as statm:
            return int(statm.read().split()[0]) * resource.getpagesize()
    except OSError:
        return 0


def stop_signals() -> list[signal.Signals]:
    """The signals that end a server in order; not SIGHUP if it is ignored, as in a program that ``nohup`` starts."""
    return [number for number in _STOP if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN]


def wake_on_signals(*signals: signal.Signals) -> socket.socket:
    """Return a socket that receives one byte, the signal's number, for each of these signals."""
    reader, writer = socket.socketpair()
    for end in (reader, writer):
        end.setblocking(False)
    _writers.append(writer)
    for number in signals:
        signal.signal(number, lambda *_: None)
    signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    return reader


#: The writing ends stay open until the process ends.
_writers: list[socket.socket] = []

"""The C client while workers and servers are really killed: its result is bitwise that of an undisturbed run."""

import ctypes
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from mesh_motion_conformance.client.scripted_server import Disturbance, ScriptedServer

from tests.faults.server_process import ServerProcess

N, STEPS, ITERATIONS = 6, 3, 2
DEADLINE_EXCEEDED, FAILED_PRECONDITION, INTERNAL, UNAVAILABLE = 4, 9, 13, 14


class Driver:
    """A square whose left side moves, or one half of it for each of two ranks, with the installed library."""

    def __init__(self, installed, endpoint, rank=None, announced=None):
        self.library = library = ctypes.CDLL(str(installed / "lib" / "libmesh_motion.so"))
        for name in ("mm_context_new", "mm_session_new", "mm_digest", "mm_token"):
            getattr(library, name).restype = ctypes.c_void_p
        for name in ("mm_error_code", "mm_error_message", "mm_id"):
            getattr(library, name).restype = ctypes.c_char_p
        self.server = ctypes.c_void_p(library.mm_context_new())
        rows = {None: (0, N), 0: (0, N // 2), 1: (N // 2, N)}[rank]
        j, i = np.divmod(np.arange((N + 1) ** 2), N + 1)
        here = (j >= rows[0]) & (j <= rows[1])
        self.points, ids = np.stack([i, j], axis=1)[here] / N, np.flatnonzero(here)
        number = np.arange(len(ids)).reshape(-1, N + 1)
        quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1)
        arrays = quads.reshape(-1, 4), number[:, 0], number[:, -1], ids
        self.kept = [np.ascontiguousarray(array, dtype=np.int64) for array in arrays]
        library.mm_set_timeouts(self.server, ctypes.c_double(60), ctypes.c_double(60))
        self.endpoint = endpoint
        self.call("mm_connect", self.server, endpoint.encode())
        self.session = ctypes.c_void_p(library.mm_session_new(self.server))
        self.call("mm_points", self.session, 2, self.size(len(self.points)), self.address(self.points))
        self.call("mm_cells", self.session, b"quad", self.size(len(self.kept[0])), self.address(self.kept[0]))
        for name, role, nodes in ((b"left", b"moving", self.kept[1]), (b"right", b"fixed", self.kept[2])):
            self.call("mm_patch", self.session, name, role, self.size(len(nodes)), self.address(nodes))
        if rank is not None:
            self.call("mm_global_ids", self.session, self.address(self.kept[3]))
            self.call("mm_set_partition", self.session, rank, 2)
        if announced is None:
            self.call("mm_open", self.session)
        else:
            token = ctypes.c_void_p(library.mm_token(announced.session))
            self.call("mm_set_credentials", self.session, announced.id.encode(), token)
            self.call("mm_join", self.session)

    size = staticmethod(ctypes.c_size_t)

    @staticmethod
    def address(array):
        return ctypes.c_void_p(array.ctypes.data)

    def call(self, name, *arguments):
        result = getattr(self.library, name)(*arguments)
        assert result == 0, (name, self.library.mm_error_code(self.server), self.library.mm_error_message(self.server))

    def build(self):
        self.call("mm_build", self.session)
        return self

    @property
    def id(self):
        return self.library.mm_id(self.session).decode()

    def move(self, step, iteration):
        y = self.points[self.kept[1], 1]
        rows = 0.02 * iteration * np.stack([np.sin(y + step), y], axis=1)
        answer = np.zeros_like(self.points)
        sizes = self.size(len(y)), self.address(rows), self.size(len(answer)), self.address(answer)
        self.call("mm_move", self.session, 0, *sizes)
        return answer.tobytes()

    def commit(self):
        self.call("mm_commit", self.session)
        return self.digest()

    def digest(self):
        return ctypes.string_at(self.library.mm_digest(self.session), 32)

    def close(self):
        self.call("mm_close", self.session, 1)
        self.library.mm_context_free(self.server)


def play(installed, endpoint, disturb):
    """All replies of a run; ``disturb(session, step, at)`` is called before each request."""
    driver, replies = Driver(installed, endpoint).build(), []
    for step in range(1, STEPS + 1):
        for iteration in range(1, ITERATIONS + 1):
            disturb(driver.id, step, iteration)
            replies.append(driver.move(step, iteration))
        disturb(driver.id, step, 0)
        replies.append(driver.commit())
    driver.close()
    return replies


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with ServerProcess(tmp_path_factory.mktemp("killed")) as running:
        yield running


@pytest.mark.nightly
def test_killed_again_and_again(installed, server):
    undisturbed = play(installed, server.endpoint, lambda *_: None)
    assert len(set(undisturbed)) == STEPS * (ITERATIONS + 1)

    def kill(session, step, at):
        if (step, at) in ((1, 0), (2, 2)):  # before a COMMIT, between two MOVEs
            server.kill_worker(session)
        if (step, at) == (3, 0):
            server.stop(signal.SIGKILL)
            server.start()

    assert play(installed, server.endpoint, kill) == undisturbed


def test_two_threads_lose_their_worker(installed, server):
    """Two ranks, each with a context and a thread of its own: both see the loss, one resumes and the other joins."""
    alone = Driver(installed, server.endpoint).build()
    expected = [(alone.move(step, 1), alone.commit())[1] for step in (1, 2)]
    alone.close()
    with ThreadPoolExecutor(2) as threads:

        def each(what):
            return list(threads.map(what, ranks))

        first = Driver(installed, server.endpoint, 0)
        ranks = [first, Driver(installed, server.endpoint, 1, announced=first)]
        each(Driver.build)
        each(lambda rank: rank.move(1, 1))
        assert each(Driver.commit) == [expected[0]] * 2
        server.kill_worker(first.id)
        failures = each(lambda rank: rank.library.mm_commit(rank.session))
        assert failures == [UNAVAILABLE, UNAVAILABLE]
        assert first.library.mm_error_code(first.server) == b"UNAVAILABLE.WORKER"
        for rank, verb in zip(ranks, ("mm_resume", "mm_join"), strict=True):
            rank.library.mm_clear_error(rank.server)
            rank.call(verb, rank.session)
        each(lambda rank: rank.move(2, 1))
        assert each(Driver.commit) == [expected[1]] * 2
        each(Driver.close)


def test_enrichment_points_of_another_dimension_are_refused(installed):
    """A caller that reads mm_dimension coordinates of each would read beyond them."""
    scripted = ScriptedServer([], {})
    try:
        driver = Driver(installed, scripted.endpoint)
        answered = scripted.session.answer

        def narrow(request):
            reply = answered(request)
            if reply.kind == "MOVED":
                reply.arrays["enrichment_points"] = np.zeros((3, 1))
            return reply

        scripted.session.answer, scripted.session.state = narrow, "READY"
        driver.call("mm_resume", driver.session)  # its reply says that there are 4 nodes, of which 2 move
        rows, answer = np.zeros((2, 2)), np.zeros((4, 2))
        sizes = driver.size(2), driver.address(rows), driver.size(4), driver.address(answer)
        assert driver.library.mm_move(driver.session, 0, *sizes) == INTERNAL
        assert b"enrichment points" in driver.library.mm_error_message(driver.server)
        driver.library.mm_context_free(driver.server)
    finally:
        scripted.close()


def test_each_session_keeps_the_number_of_its_unanswered_opening(installed):
    """Two sessions of one context are opened while the server is silent: each repeat is the same request."""
    scripted = ScriptedServer([Disturbance("OPEN", "drop", nth=2, times=2)], {})
    try:
        driver = Driver(installed, scripted.endpoint)
        driver.library.mm_set_timeouts(driver.server, ctypes.c_double(0.2), ctypes.c_double(0.2))
        sessions = [ctypes.c_void_p(driver.library.mm_session_new(driver.server)) for _ in range(2)]
        for session, label in zip(sessions, (b"wing", b"flap"), strict=True):
            driver.call("mm_points", session, 2, driver.size(len(driver.points)), driver.address(driver.points))
            driver.call("mm_set_label", session, label)
            assert driver.library.mm_open(session) == DEADLINE_EXCEEDED
            driver.library.mm_clear_error(driver.server)
        driver.library.mm_set_timeouts(driver.server, ctypes.c_double(60), ctypes.c_double(60))
        for session in sessions:
            driver.call("mm_open", session)
        opened = [seen.message for seen in scripted.seen if seen.message.kind == "OPEN"][1:]
        assert [message.fields["label"] for message in opened] == ["wing", "flap"] * 2
        first, second, *again = [message.sequence for message in opened]
        assert again == [first, second]
        assert first != second
        driver.library.mm_context_free(driver.server)
    finally:
        scripted.close()


def test_a_reply_has_no_more_frames_than_the_mesh_can_fill(installed):
    scripted = ScriptedServer([Disturbance("STATUS", "garbage", given={"frames": ["c0"] * 1000})], {})
    try:
        driver = Driver(installed, scripted.endpoint)
        assert driver.library.mm_status(driver.session) == INTERNAL
        assert b"more frames than the mesh" in driver.library.mm_error_message(driver.server)
        driver.library.mm_clear_error(driver.server)
        driver.call("mm_status", driver.session)
        driver.library.mm_context_free(driver.server)
    finally:
        scripted.close()


def test_arrays_of_many_frames(installed):
    """Uploads in parts of two chunks, without a copy; downloads in three chunks, the last one shorter."""
    scripted = ScriptedServer([], {})
    try:
        driver = Driver(installed, scripted.endpoint)
        points = np.random.default_rng(1).random((2_200_000, 2))
        driver.call("mm_points", driver.session, 2, driver.size(len(points)), driver.address(points))
        driver.build()
        sent = [seen.message for seen in scripted.seen if seen.message.fields.get("item") == "nodes"]
        assert [len(message.arrays["rows"]) for message in sent] == [2 << 20, len(points) - (2 << 20)]
        np.testing.assert_array_equal(np.concatenate([message.arrays["rows"] for message in sent]), points)
        scripted.session.points = points[::-1].copy()
        answer = np.zeros_like(points)
        driver.call("mm_fetch", driver.session, 0, driver.size(len(points)), driver.address(answer))
        np.testing.assert_array_equal(answer, points[::-1])
        driver.close()
    finally:
        scripted.close()


WARNING = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_char_p)


def test_a_server_that_is_gone_is_said_to_be_so_within_seconds(installed):
    """Once for each outage, while the call waits; by default the same line goes to standard error."""
    scripted, lines = ScriptedServer([], {}), []
    driver = Driver(installed, scripted.endpoint).build()
    warning = WARNING(lambda _data, line: lines.append((time.monotonic(), line.decode())))
    driver.call("mm_set_warning", driver.server, warning, None)
    scripted.close()
    driver.library.mm_set_timeouts(driver.server, ctypes.c_double(4), ctypes.c_double(4))
    started = time.monotonic()
    assert driver.library.mm_commit(driver.session) in (UNAVAILABLE, DEADLINE_EXCEEDED)
    ((said_at, line),) = lines
    assert said_at - started < 3
    assert line.startswith(f"no server answers at {driver.endpoint}; asking for ")
    driver.library.mm_context_free(driver.server)


def test_a_warning_goes_to_standard_error_unless_that_is_closed(installed, tmp_path):
    program = """if 1:
        import ctypes, os, sys
        library = ctypes.CDLL(sys.argv[1])
        library.mm_context_new.restype = ctypes.c_void_p
        server = ctypes.c_void_p(library.mm_context_new())
        library.mm_set_timeouts(server, ctypes.c_double(2.2), ctypes.c_double(2.2))
        os.dup2(os.open(sys.argv[2], os.O_WRONLY | os.O_CREAT), 2)
        assert library.mm_connect(server, b"ipc:///nowhere/control") == 14
    """
    library, said = str(installed / "lib" / "libmesh_motion.so"), [tmp_path / "open", tmp_path / "closed"]
    for path, redirection in zip(said, ("", "2>&-"), strict=True):
        shell = ["sh", "-c", f'exec "$@" {redirection}', "sh", sys.executable, "-c", program, library, str(path)]
        assert subprocess.run(shell, check=False).returncode == 0
    expected = r"mesh_motion: no server answers at ipc:///nowhere/control; asking for \d s\n"
    assert re.fullmatch(expected, said[0].read_text())
    assert said[1].read_text() == ""


def test_a_forked_child_is_refused_at_once_and_leaves_its_parent_alone(installed):
    scripted = ScriptedServer([], {})
    try:
        driver = Driver(installed, scripted.endpoint).build()
        child = os.fork()
        if not child:
            verbs = "mm_status", "mm_rollback", "mm_close"
            refused = [getattr(driver.library, verb)(driver.session, 0) for verb in verbs]
            said = driver.library.mm_error_message(driver.server)
            driver.library.mm_context_free(driver.server)
            os._exit(refused != [FAILED_PRECONDITION] * 3 or b"a forked child" not in said)
        assert os.waitpid(child, 0)[1] == 0
        driver.call("mm_status", driver.session)
        driver.close()
    finally:
        scripted.close()

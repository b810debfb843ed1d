"""The C client while workers and servers are killed for real: it ends bitwise where an undisturbed run ends."""

import ctypes
import signal

import numpy as np
import pytest

N, STEPS, ITERATIONS = 7, 3, 2


class Driver:
    """A square whose left side moves, by the installed library."""

    def __init__(self, installed, endpoint):
        self.library = library = ctypes.CDLL(str(installed / "lib" / "libmesh_motion.so"))
        for name in ("mm_context_new", "mm_session_new", "mm_digest"):
            getattr(library, name).restype = ctypes.c_void_p
        for name in ("mm_error_code", "mm_error_message", "mm_id"):
            getattr(library, name).restype = ctypes.c_char_p
        self.server = ctypes.c_void_p(library.mm_context_new())
        j, i = np.divmod(np.arange((N + 1) ** 2), N + 1)
        number = np.arange((N + 1) ** 2).reshape(N + 1, N + 1)
        quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
        self.points = np.stack([i, j], axis=1) / N
        self.kept = [np.ascontiguousarray(a, dtype=np.int64) for a in (quads, number[:, 0], number[:, -1])]
        library.mm_set_timeouts(self.server, ctypes.c_double(60), ctypes.c_double(60))
        self.call("mm_connect", self.server, endpoint.encode())
        self.session = ctypes.c_void_p(library.mm_session_new(self.server))
        self.call("mm_points", self.session, 2, self.size(len(self.points)), self.address(self.points))
        self.call("mm_cells", self.session, b"quad", self.size(N * N), self.address(self.kept[0]))
        for name, role, nodes in ((b"left", b"moving", self.kept[1]), (b"right", b"fixed", self.kept[2])):
            self.call("mm_patch", self.session, name, role, self.size(N + 1), self.address(nodes))
        self.call("mm_open", self.session)
        self.call("mm_build", self.session)

    size = staticmethod(ctypes.c_size_t)

    @staticmethod
    def address(array):
        return ctypes.c_void_p(array.ctypes.data)

    def call(self, name, *arguments):
        result = getattr(self.library, name)(*arguments)
        assert result == 0, (name, self.library.mm_error_code(self.server), self.library.mm_error_message(self.server))

    @property
    def id(self):
        return self.library.mm_id(self.session).decode()

    def move(self, step, iteration):
        y = self.points[self.kept[1], 1]
        rows = 0.02 * iteration * np.stack([np.sin(y + step), y], axis=1)
        answer = np.zeros_like(self.points)
        sizes = self.size(N + 1), self.address(rows), self.size(len(answer)), self.address(answer)
        self.call("mm_move", self.session, 0, *sizes)
        return answer.tobytes()

    def commit(self):
        self.call("mm_commit", self.session)
        return ctypes.string_at(self.library.mm_digest(self.session), 32)

    def close(self):
        self.call("mm_close", self.session, 1)
        self.library.mm_context_free(self.server)


def play(installed, endpoint, disturb):
    """All replies of a run; ``disturb(session, step, at)`` is called before each request."""
    driver, replies = Driver(installed, endpoint), []
    for step in range(1, STEPS + 1):
        for iteration in range(1, ITERATIONS + 1):
            disturb(driver.id, step, iteration)
            replies.append(driver.move(step, iteration))
        disturb(driver.id, step, 0)
        replies.append(driver.commit())
    driver.close()
    return replies


@pytest.fixture
def server(tools, tmp_path):
    running = tools["Server"](tmp_path)
    yield running
    running.stop()


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_killed_again_and_again(installed, server):
    undisturbed = play(installed, server.endpoint, lambda *_: None)
    assert len(set(undisturbed)) == STEPS * (ITERATIONS + 1)

    def kill(session, step, at):
        if at == (step % 3):  # before a COMMIT, the first MOVE, the second MOVE
            server.kill_worker(session)

    def restart(_, step, at):
        if (step, at) in ((1, 0), (2, 2)):
            server.stop(signal.SIGKILL if at else signal.SIGTERM)
            server.start()

    assert play(installed, server.endpoint, kill) == undisturbed
    assert play(installed, server.endpoint, restart) == undisturbed

"""The driver program of this client for the conformance suite: ``python -m mesh_motion_client.conformance``.

``protocol/conformance/README.md`` has the contract: verbs in, one JSON object a line out.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from typing import Any, Literal

import numpy as np
from mesh_motion_protocol.errors import MeshMotionError

from mesh_motion_client.mesh import Mesh, Patch
from mesh_motion_client.server import Server, connect
from mesh_motion_client.session import Frame, Session

__all__ = ["Driver", "main", "play"]

_MESH = Mesh(
    np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]),
    {"triangle": np.array([[0, 1, 2], [0, 2, 3]])},
    {"left": Patch("moving", np.array([0, 3])), "right": Patch("fixed", np.array([1, 2]))},
)
#: Vectors for the verbs tangent and cotangent.
_VELOCITY, _WEIGHTS = np.tile([0.25, 0.125], (2, 1)), np.arange(1, 9).reshape(4, 2) / 8

Result = dict[str, Any]


class Driver:
    """One run: a server, a session, and how many displacements were given.

    Parameters
    ----------
    timeout : float
        Seconds for each verb.
    """

    def __init__(self, endpoint: str, timeout: float) -> None:
        self._endpoint, self._timeout = endpoint, timeout
        self._moves = 0
        self._server: Server | None = None
        self._session: Session | None = None
        self._last: Callable[[], Result] = dict

    @property
    def server(self) -> Server:
        """The server that ``hello`` connected to."""
        if self._server is None:
            raise MeshMotionError("there is no server", code="UNAVAILABLE")
        return self._server

    @property
    def session(self) -> Session:
        """The session that ``open`` opened."""
        if self._session is None:
            raise MeshMotionError("there is no session", code="FAILED_PRECONDITION.STATE")
        return self._session

    def do(self, verb: str) -> Result:
        """Do one verb; return the line to print."""
        if verb != "again":
            self._last = self._call(verb)
        try:
            return {"verb": verb, "ok": True} | self._last()
        except MeshMotionError as error:
            return {"verb": verb, "ok": False, "code": error.code, "message": error.message}

    def close(self) -> None:
        """End the connections of the session and to the server, if open."""
        if self._session is not None:
            self._session.leave()
        if self._server is not None:
            self._server.close()

    def _call(self, verb: str) -> Callable[[], Result]:
        """Return the call for a verb; it can be repeated without other effects."""
        if verb in ("move", "move-reference"):
            self._moves += 1
            return lambda k=self._moves: self._move("committed" if verb == "move" else "reference", k)  # type: ignore[misc]
        calls: dict[str, Callable[[], Result]] = {
            "hello": self._hello,
            "open": self._open,
            "resume": self._resume,
            "commit": self._commit,
            "rollback": self._rollback,
            "status": lambda: {key: getattr(self.session.status(), key) for key in ("state", "step")},
            "tangent": lambda: {"velocity": self.session.tangent(_VELOCITY).ravel().tolist()},
            "cotangent": lambda: {"weights": self.session.cotangent(_WEIGHTS).ravel().tolist()},
            "points": lambda: {"points": self.session.points().ravel().tolist()},
            "close": lambda: self._close("keep"),
            "discard": lambda: self._close("discard"),
        }
        return calls[verb]

    def _hello(self) -> Result:
        self._server = connect(self._endpoint, timeout=self._timeout, compute_timeout=self._timeout)
        return {"version": self._server.welcome.version}

    def _open(self) -> Result:
        self._session = self.server.open(_MESH)
        return {"moving_nodes": self.session.moving_nodes.tolist()}

    def _resume(self) -> Result:
        resumed = self.server.resume(self.session.credentials)
        self.session.leave()
        self._session = resumed
        return {"step": self.session.step}

    def _move(self, frame: Frame, number: int) -> Result:
        rows = np.tile([number / 8, number / 16], (2, 1))
        moved = self.session.move(rows, frame=frame)
        return {"iteration": moved.iteration, "displacement": moved.displacement.ravel().tolist()}

    def _rollback(self) -> Result:
        self.session.rollback()
        return {}

    def _close(self, outcome: Literal["keep", "discard"]) -> Result:
        self.session.close(outcome)
        return {}

    def _commit(self) -> Result:
        committed = self.session.commit()
        return {"step": committed.step, "digest": committed.digest.hex()}


def play(endpoint: str, timeout: float, verbs: str) -> Iterator[Result]:
    """Do the verbs of a scenario in their order; yield a line for each."""
    driver = Driver(endpoint, timeout)
    yield from map(driver.do, verbs.split())
    driver.close()


def main(arguments: list[str] | None = None) -> int:
    """Print the lines of a scenario."""
    parser = argparse.ArgumentParser(prog="mesh_motion_client.conformance")
    parser.add_argument("--endpoint", required=True)
    parser.add_argument("--timeout", type=float, default=10.0)
    parser.add_argument("--scenario", required=True, help="verbs, separated by blanks")
    given = parser.parse_args(arguments)
    for line in play(given.endpoint, given.timeout, given.scenario):
        sys.stdout.write(json.dumps(line) + "\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Sessions as a server tells them: LIST, and STATUS of the one that is looked at.

A server tells no history. What is charted are the commits that were seen since the monitor was started.
"""

from __future__ import annotations

import time
import uuid
from typing import Any

import numpy as np
from mesh_motion_client import Keys, MeshMotionError, Server, connect
from mesh_motion_client.control import Control
from mesh_motion_protocol.messages import Probe, Probed, Status, StatusReport

from mesh_motion_server.watch.terminal.sources import Details, Message, SessionLine, Unreadable, in_order

__all__ = ["EndpointSource"]

_LACKS = (
    "Asked over the wire: no history, phases, warnings or refusals. Commits are charted from now on; "
    "a monitor key is told no places of cells. On the server's machine `mesh-motion monitor FOLDER` shows all."
)
_LIST_ALONE = "A server without keys tells nobody but its holder more of a session than this list."
#: STATUS needs no token; the field takes any 32 bytes.
_NO_TOKEN = bytes(32)
_MOST_SAMPLES = 100_000


class EndpointSource:
    """The sessions of a running server, as far as it lets this key see them.

    Parameters
    ----------
    endpoint : str
    keys : Keys, optional
    timeout : float
        Seconds to wait for an answer.
    """

    def __init__(self, endpoint: str, keys: Keys | None = None, timeout: float = 5.0) -> None:
        self.where = endpoint
        self._keys, self._timeout = keys, timeout
        self._server: Server | None = None
        self._control: Control | None = None
        self._samples: dict[str, list[tuple[float, ...]]] = {}
        self._client, self._sequence = uuid.uuid4().bytes, 0

    def sessions(self) -> list[SessionLine]:
        """See :class:`~.sources.Source`."""
        try:
            if self._server is None:
                self._server = connect(self.where, timeout=self._timeout, keys=self._keys)
                self._control = Control(self.where, self._keys)
            listed = self._server.sessions()
        except MeshMotionError as error:
            self.close()
            raise Unreadable(str(error), error.code) from error
        lines = [_line(session, self._samples.get(session["session"])) for session in listed]
        known = {line.session for line in lines}
        self._samples = {session: samples for session, samples in self._samples.items() if session in known}
        return in_order(lines)

    def details(self, session: str, seconds: float) -> Details | None:
        """See :class:`~.sources.Source`."""
        samples = self._samples.setdefault(session, [])
        if self._control is None:
            return None
        try:
            report = self._status(self._control, session, max(seconds, self._timeout))
        except MeshMotionError as error:
            why = _LIST_ALONE if error.code == "NOT_FOUND" else f"{error}."
            return self._details(samples, lacks=f"{why} {_LACKS}")
        if report is None:
            return self._details(samples, lacks=f"No process holds the session now. {_LACKS}")
        quality = report.report.get("quality", {})
        values = quality.get("metric", {})
        if values and (not samples or samples[-1][0] != report.step):
            while samples and samples[-1][0] >= report.step:
                samples.pop()
            names = ("min", "p1", "p5", "p50", "mean")
            samples.append((float(report.step), time.time(), *(float(values.get(name, np.nan)) for name in names)))
            del samples[:-_MOST_SAMPLES]
        trial = f"step {report.step + 1}, iteration {report.iteration}" if report.iteration else ""
        waits = f"waits for partitions {', '.join(map(str, report.waiting_for))}" if report.waiting_for else ""
        return self._details(samples, lacks=_LACKS, trial=trial, waits=waits, worst=quality.get("worst", []))

    def verdict(self, lines: list[SessionLine]) -> str:
        """See :class:`~.sources.Source`."""
        del lines
        return ""

    def close(self) -> None:
        """See :class:`~.sources.Source`."""
        for connection in (self._server, self._control):
            if connection is not None:
                connection.close()
        self._server = self._control = None

    def _status(self, control: Control, session: str, seconds: float) -> StatusReport | None:
        """The worker's report; None where no worker has the session."""
        probed = control.ask(Probe, Probed, seconds, session=session, token=_NO_TOKEN)
        if probed.worker != "alive":
            return None
        self._sequence += 1
        connection = control.data_connection(probed.endpoint)
        try:
            request = Status(client=self._client, sequence=self._sequence, session=session, epoch=probed.epoch)
            reply = connection.request(request, time.monotonic() + seconds)
        finally:
            connection.close()
        return reply if isinstance(reply, StatusReport) else None

    def _details(
        self, samples: list[tuple[float, ...]], *, lacks: str, trial: str = "", waits: str = "", worst: Any = ()
    ) -> Details:
        table = np.array(samples, dtype=np.float64).reshape(len(samples), 7)
        names = ("step", "at", "actual_min", "actual_p1", "actual_p5", "actual_p50", "actual_mean")
        messages = [Message(time.time(), "waiting", None, waits)] if waits else []
        return Details(
            metric="quality",
            threshold=None,
            columns=dict(zip(names, table.T, strict=True)),
            trial=trial,
            worst=list(worst),
            messages=messages,
            lacks=lacks,
        )


def _line(session: dict[str, Any], samples: list[tuple[float, ...]] | None) -> SessionLine:
    last = samples[-1] if samples else None
    return SessionLine(
        session=session["session"],
        label=str(session.get("label", "")),
        state=str(session.get("state", "")),
        step=int(session.get("step", 0)),
        minimum=last[2] if last else None,
        changed_at=last[1] if last else None,
        is_live=session.get("worker") == "alive",
        is_recorded=False,
    )

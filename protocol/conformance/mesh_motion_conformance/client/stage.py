"""Runs a scenario with a client's driver program, and checks its output and its requests."""

from __future__ import annotations

import json
import shlex
import subprocess
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

from mesh_motion_conformance.case import Skip, Unmet, require
from mesh_motion_conformance.client.scenario import Scenario
from mesh_motion_conformance.client.scripted_server import ScriptedServer, Seen
from mesh_motion_conformance.client.scripted_session import ScriptedSession
from mesh_motion_conformance.show import show

__all__ = ["Client", "ClientStage"]

#: A client in Python that plays a scenario in this process: (endpoint, time-out, verbs) → the lines of its driver.
Client = Callable[[str, float, str], Iterable[dict[str, Any]]]

#: A driver may take this long to start and end, in addition to the time of its verbs, seconds.
_START_SECONDS = 20.0


class ClientStage:
    """A client under test: a driver program with its arguments, as for a shell, or a client in this process."""

    def __init__(self, client: str | Client) -> None:
        self.client = client
        self.sent = ""

    def between(self) -> None:
        """Each scenario has a server of its own."""

    def mend(self) -> None:
        """Each scenario has a server of its own."""

    def close(self) -> None:
        """Nothing is kept."""

    def play(self, scenario: Scenario) -> None:
        """Run the driver with the script, then check the results."""
        self.sent = f"verbs {scenario.verbs!r}"
        server = ScriptedServer(list(scenario.disturbances), dict(scenario.welcome))
        try:
            lines = self._drive(scenario, server.endpoint)
        finally:
            server.close()
        _judge_lines(scenario, lines)
        _judge_requests(scenario, server)

    def _drive(self, scenario: Scenario, endpoint: str) -> list[dict[str, Any]]:
        """The driver's lines."""
        if not isinstance(self.client, str):
            return list(self.client(endpoint, scenario.timeout, scenario.verbs))
        options = ["--endpoint", endpoint, "--timeout", str(scenario.timeout), "--scenario", scenario.verbs]
        allowed = _START_SECONDS + (scenario.timeout + 3) * len(scenario.verbs.split())
        try:
            done = subprocess.run(
                [*shlex.split(self.client), *options], capture_output=True, text=True, timeout=allowed, check=False
            )
        except subprocess.TimeoutExpired:
            raise Unmet(f"an end within {allowed:g} s", "the driver was still running") from None
        except OSError as error:
            raise Skip(f"the driver cannot be started: {error}") from None
        if done.returncode:
            raise Unmet("exit status 0: errors are reported in lines", f"{done.returncode}: {done.stderr[-300:]!r}")
        try:
            return [json.loads(line) for line in done.stdout.splitlines() if line.strip()]
        except ValueError as error:
            raise Unmet("one JSON object a line", f"{error}: {done.stdout[:300]!r}") from None


def _judge_lines(scenario: Scenario, lines: list[dict[str, Any]]) -> None:
    """Check that the output has one line for each verb, as expected."""
    verbs = scenario.verbs.split()
    if [line.get("verb") for line in lines] != verbs[: len(lines)] or len(lines) < len(verbs):
        raise Unmet(f"a line for each of {verbs}", str(lines)[:600])
    for number, line in enumerate(lines, start=1):
        codes = scenario.codes.get(number)
        if codes is None and line.get("ok") is not True:
            raise Unmet(f"verb {number}, {line['verb']}, to succeed", str(line)[:300])
        if codes is not None and not (line.get("ok") is False and _begins(line.get("code"), codes)):
            raise Unmet(f"verb {number}, {line['verb']}, to report {' or '.join(codes) or 'an error'}", str(line)[:300])
        for key, value in scenario.results.get(number, {}).items():
            wanted = _digest() if value == "sha256 of step 1" else value
            require(_equal(line.get(key), wanted), f"verb {number}, {line['verb']}: {key} = {wanted}", str(line)[:300])


def _begins(code: Any, codes: list[str]) -> bool:
    return isinstance(code, str) and any(code.startswith(wanted) for wanted in codes)


def _equal(got: Any, wanted: Any) -> bool:
    if isinstance(wanted, list):
        return isinstance(got, list) and len(got) == len(wanted) and all(map(_equal, got, wanted))
    return bool(got == wanted)


def _digest() -> str:
    """Digest of step 1 after the first displacement, by section 16."""
    from mesh_motion_conformance.client.contract import LEFT, POINTS  # noqa: PLC0415
    from mesh_motion_conformance.server.section_15_reports import digest  # noqa: PLC0415

    points = POINTS.copy()
    points[LEFT] += [0.125, 0.0625]
    return digest(1, points).hex()


def _judge_requests(scenario: Scenario, server: ScriptedServer) -> None:
    """Check the arrived messages: all are requests, ids are used once, and the counts are those of the scenario."""
    require(not server.broken, "messages of SPEC.md", "".join(server.broken[:1]))
    for seen in server.seen:
        got = f"{', '.join(seen.wrong[:1])}: {show(seen.message)}"
        require(not seen.wrong, "requests as sections 4, 5 and 12 want them", got)
    _judge_ids(server.seen)
    _judge_counts(scenario, server.session, server.seen)


def _judge_ids(seen: list[Seen]) -> None:
    """A client does not use one id for two requests, and counts upwards."""
    contents: dict[tuple[str, bytes, int], str] = {}
    highest: dict[tuple[str, bytes], int] = {}
    for entry in seen:
        message = entry.message
        key = entry.endpoint, message.client, message.sequence
        fields = {name: value for name, value in message.fields.items() if name not in ("epoch", "memory")}
        content = f"{message.kind} {fields} {[array.tobytes() for array in message.arrays.values()]}"
        if contents.setdefault(key, content) != content:
            raise Unmet("one id for one request (SPEC 4)", f"{message.sequence} for another: {show(message)}")
        known = highest.setdefault(key[:2], 0)
        if message.sequence > known + 16:
            raise Unmet("sequence counted upwards by 1 (SPEC 4)", f"{message.sequence} after {known}")
        highest[key[:2]] = max(known, message.sequence)


def _judge_counts(scenario: Scenario, session: ScriptedSession, seen: list[Seen]) -> None:
    arrivals = Counter(entry.message.kind for entry in seen)
    for kind, count in scenario.executed.items():
        require(session.executed[kind] == count, f"{kind} executed {count} times", f"{session.executed[kind]} times")
    for kind, wanted in scenario.arrivals.items():
        least = int(str(wanted).rstrip("+"))
        if arrivals[kind] < least or (not str(wanted).endswith("+") and arrivals[kind] != least):
            raise Unmet(f"{kind} sent {wanted} times", f"{arrivals[kind]} times")
    ids = {kind: [(e.message.client, e.message.sequence) for e in seen if e.message.kind == kind] for kind in arrivals}
    for kind in scenario.same:
        if len(set(ids.get(kind, []))) != 1:
            raise Unmet(f"one id for all of {kind}", str([sequence for _, sequence in ids.get(kind, [])]))
    for kind in scenario.new:
        if len(set(ids.get(kind, []))) != len(ids.get(kind, [])):
            raise Unmet(f"an id of its own for each {kind}", str([sequence for _, sequence in ids.get(kind, [])]))
    for kind, fields in scenario.sent.items():
        for entry in seen:
            found = {name: entry.message.fields.get(name) for name in fields}
            require(entry.message.kind != kind or found == fields, f"{kind} with {fields}", show(entry.message))

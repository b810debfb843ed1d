"""The pages of a real server, compared with the requests of a client."""

import os
import re
import signal
from pathlib import Path
from typing import Any

import pytest
from mesh_motion_client import MeshMotionError, connect
from prometheus_client.parser import text_string_to_metric_families
from served import small_mesh

from mesh_motion_server.operation.metrics import METRICS, PREFIX
from tests.faults.waiting import wait_until

#: prometheus.io/docs/practices/naming: base units, and the objections of `promtool check metrics`.
_OTHER_UNITS = re.compile(r"_(ms|milliseconds|minutes|hours|kb|kilobytes|mb|megabytes|percent)(_|$)")


def lint(text: str) -> list[str]:
    """The checks of `promtool check metrics` for names, units, types and helps."""
    wrong = []
    helps = dict(re.findall(r"^# HELP (\S+) ?(.*)$", text, re.MULTILINE))
    for name, kind in re.findall(r"^# TYPE (\S+) (\S+)$", text, re.MULTILINE):
        help_text = helps.get(name, "")
        faults = {
            "a name is lower case with the prefix": not re.fullmatch(rf"{PREFIX}[a-z][a-z0-9_]*", name),
            "no help text": not help_text.endswith("."),
            "_total is for counters, and they have it": (kind == "counter") != name.endswith("_total"),
            "this ending is a histogram's own": name.endswith(("_count", "_sum", "_bucket")),
            "use the base unit": bool(_OTHER_UNITS.search(name)),
            "seconds belong into the name": "in seconds" in help_text and "seconds" not in name,
            "bytes belong into the name": "bytes" in help_text.lower() and "bytes" not in name,
        }
        wrong += [f"{name}: {fault}" for fault, found in faults.items() if found]
    for family in text_string_to_metric_families(text):
        keys = {key for sample in family.samples for key in sample.labels}
        if keys & {"session", "owner", "path", "label", "peer"}:
            wrong.append(f"{family.name}: a label names one session")
    return wrong


def test_a_seeded_offence_is_seen() -> None:
    assert lint("# HELP mesh_motion_x_ms No unit.\n# TYPE mesh_motion_x_ms gauge\nmesh_motion_x_ms 1\n")
    assert lint("# HELP mesh_motion_x\n# TYPE mesh_motion_x gauge\nmesh_motion_x 1\n")
    assert lint('# HELP mesh_motion_x Y.\n# TYPE mesh_motion_x gauge\nmesh_motion_x{session="1"} 1\n')
    assert lint("# HELP mesh_motion_x Y.\n# TYPE mesh_motion_x counter\nmesh_motion_x 1\n")


def test_the_numbers_are_those_of_the_client(serve: Any) -> None:
    server = serve()
    wait_until(lambda: server.get("/readyz")[0] == 200, "ready")
    mesh = small_mesh()
    with connect(server.endpoint, timeout=60) as client:
        session = client.open(mesh, {"support_radius": 1.0})
        rows = 0.01 * mesh.points[session.moving_nodes]
        for _ in range(3):
            session.move(rows)
            session.move(2 * rows, report="headroom")
            session.commit()
        with pytest.raises(MeshMotionError, match="no trial"):
            session.commit()

        def counted() -> Any:
            found = server.metrics()
            return (
                found
                if found["commits_total"] == 3 and ("refused_total", "FAILED_PRECONDITION.STATE") in found
                else None
            )

        found = wait_until(counted, "the counts arrive")
        assert found["moves_total"] == found["move_seconds_count"] == found["move_min_quality_count"] == 6
        assert found["move_headroom_steps_count"] == found["commit_seconds_count"] == 3
        assert found["builds_total"] == 1
        assert found["refused_total", "FAILED_PRECONDITION.STATE"] == 1
        assert 0 < found["move_seconds_sum"] < 60
        assert found["move_seconds_bucket", "+Inf"] == 6
        assert found["sessions", "READY"] == 1
        assert found["fsync_seconds_count"] >= 6
        assert found["journal_written_bytes_total"] > 3 * mesh.points.nbytes
        assert found["received_bytes_total"] > mesh.points.nbytes + 6 * rows.nbytes
        assert found["sent_bytes_total"] > 6 * mesh.points.nbytes
        assert found["worker_resident_bytes"] > found["largest_worker_resident_bytes"] > 20e6
        assert found["disk_size_bytes"] >= found["disk_free_bytes"] > 0
        assert found["build_info", "1.0", *_versions(found)[1:]] == 1
        assert lint(server.get("/metrics")[1]) == []

        worker = server.events("worker_started")[0]["worker"]
        scores = {pid: int(Path(f"/proc/{pid}/oom_score_adj").read_text()) for pid in (server.process.pid, worker)}
        assert scores[worker] > scores[server.process.pid]  # the kernel takes a worker when the memory is full:
        os.kill(worker, signal.SIGKILL)  # what it had done stays counted, and the next one's work is added
        session.move(rows)
        session.commit()
        found = wait_until(lambda: (m := server.metrics())["commits_total"] == 4 and m, "the counts arrive")
        assert found["moves_total"] == 7
        assert found["worker_ends_total", "signal"] == 1
        session.close("discard")
    names = {
        line.split()[2].removesuffix("_total") for line in server.get("/metrics")[1].splitlines() if "HELP" in line
    }
    assert names == {PREFIX + name for name in METRICS} | {PREFIX + "build_info"}
    assert server.stop() == 0


def _versions(found: dict[Any, float]) -> tuple[str, ...]:
    return next(key[1:] for key in found if key[0] == "build_info")

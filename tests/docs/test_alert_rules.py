"""The alert rules of docs/operations.md in Prometheus' own tests: when each rule fires, and when it does not; and the
board for Grafana uses existing metrics, in expressions that Prometheus can read.
"""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from mesh_motion_server.operation.metrics import METRICS, PREFIX

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "operations.md").read_text(encoding="utf-8")
BOARD = (DOCS / "grafana.json").read_text(encoding="utf-8")
#: The labels that Prometheus adds to each series of the page's scrape.
SCRAPED = {"job": "mesh-motion", "instance": "host:9464"}
#: The text of an alert, in addition to its labels.
ANNOTATED = {"MeshEndsSoon": {"exp_annotations": {"summary": "a mesh ends within 14 steps like its last one"}}}
#: Scrapes a minute.
PER_MINUTE = 4


def rules() -> str:
    (block,) = (b for b in re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL) if b.startswith("groups:"))
    return str(block)


def series(name: str, values: str, **labels: str) -> dict[str, str]:
    written = ",".join(f'{key}="{value}"' for key, value in (SCRAPED | labels).items())
    return {"series": f"{name}{{{written}}}", "values": values}


def minutes(count: float, value: float, slope: float = 0.0) -> str:
    """This value for this time, or this value plus an increment at each scrape."""
    return f"{value:g}{slope:+g}x{round(count * PER_MINUTE) - 1}"


def steps(*parts: tuple[float, float]) -> str:
    """(minutes, value) one after the other."""
    return " ".join(minutes(count, value) for count, value in parts)


def histogram(name: str, observed: float) -> list[dict[str, str]]:
    """A histogram to which one observation is added at each scrape for an hour."""
    ends = [*METRICS[name].bounds, float("inf")]
    return [
        series(f"{PREFIX}{name}_bucket", minutes(60, 0, float(observed <= end)), le=f"{end:g}".replace("inf", "+Inf"))
        for end in ends
    ]


def at_most_14(values: str) -> list[dict[str, str]]:
    """The bucket of moves with a headroom of 14 steps or fewer."""
    return [series(PREFIX + "move_headroom_steps_bucket", values, le="14.0")]


FALLS, ENDS, REFUSED = (PREFIX + name for name in ("gateway_falls_total", "worker_ends_total", "refused_total"))
DISK = PREFIX + "disk_free_bytes"
#: Alert, the series, minutes at which it speaks, minutes at which it is silent, labels that are not the scrape's.
CASES: list[tuple[str, list[dict[str, str]], list[float], list[float], dict[str, str]]] = [
    ("Down", [series("up", steps((5, 1), (5, 0), (5, 1)))], [8, 9.5], [4, 6, 12], {}),
    ("NotReady", [series(PREFIX + "ready", steps((5, 1), (10, 0), (5, 1)))], [11], [4, 9, 16], {}),
    (
        "SessionFrozen",
        [
            series(PREFIX + "sessions", steps((5, 0), (5, 1)), state="FROZEN"),
            series(PREFIX + "sessions", minutes(10, 3), state="READY"),
        ],
        [6],
        [4],
        {"state": "FROZEN"},
    ),
    ("DiskFillsUp", [series(DISK, minutes(60, 40e9, -20e6))], [50], [20], {}),  # full in 8 hours
    ("DiskFillsUp", [series(DISK, minutes(60, 400e9, -10e6))], [], [20, 50], {}),  # in a week
    ("DiskHangs", [series(PREFIX + "disk_silence_seconds", steps((5, 0), (1, 20), (4, 60)))], [7], [5.5], {}),
    # one failure; a server that was restarted after three
    ("GatewayFalls", [series(FALLS, steps((20, 0), (20, 1)))], [20.25, 25, 29], [10, 19, 35], {}),
    ("GatewayFalls", [series(FALLS, steps((20, 3), (20, 0)))], [], [10, 21, 25], {}),
    ("Defect", [series(REFUSED, steps((20, 0), (20, 1)), code="INTERNAL")], [21], [10, 35], {"code": "INTERNAL"}),
    ("Defect", [series(REFUSED, minutes(30, 0, 1), code="NOT_FOUND")], [], [20], {}),
    (
        "WorkersFall",
        [series(ENDS, steps((20, 0), (20, 2)), how=how) for how in ("signal", "failure")],
        [22, 28],
        [19, 35],
        {},
    ),
    ("WorkersFall", [series(ENDS, steps((20, 0), (20, 3)), how="signal")], [], [20.25, 22, 29], {}),
    ("WorkersFall", [series(ENDS, minutes(40, 0, 1), how="orderly")], [], [20, 30], {}),
    ("SlowDisk", histogram("fsync_seconds", 0.5), [30], [], {}),
    ("SlowDisk", histogram("fsync_seconds", 0.02), [], [30], {}),
    ("MeshesGetPoor", histogram("move_min_quality", 0.04), [40], [], {}),
    ("MeshesGetPoor", histogram("move_min_quality", -0.2), [40], [], {}),
    ("MeshesGetPoor", histogram("move_min_quality", 0.35), [], [40], {}),
    ("MeshEndsSoon", at_most_14(steps((20, 3), (20, 4))), [21, 29], [19, 35], {"le": "14.0"}),
    ("MeshEndsSoon", histogram("move_headroom_steps", 14.5), [], [30], {}),
]


def as_test(alert: str, given: list[dict[str, str]], spoken: list[float], silent: list[float], labels: Any) -> Any:
    expected = [{"exp_labels": SCRAPED | labels} | ANNOTATED.get(alert, {})]
    asked = [(minute, expected) for minute in spoken] + [(minute, []) for minute in silent]
    return {
        "interval": "15s",
        "input_series": given,
        "alert_rule_test": [
            {"eval_time": f"{round(60 * minute)}s", "alertname": f"MeshMotion{alert}", "exp_alerts": alerts}
            for minute, alerts in asked
        ],
    }


def verdict(folder: Path, text: str) -> subprocess.CompletedProcess[str]:
    promtool = shutil.which("promtool")
    if promtool is None:
        pytest.skip("promtool (Debian: prometheus) is not installed")
    (folder / "rules.yml").write_text(text, encoding="utf-8")
    tests = {"rule_files": ["rules.yml"], "evaluation_interval": "15s", "tests": [as_test(*case) for case in CASES]}
    (folder / "test.yml").write_text(json.dumps(tests), encoding="utf-8")
    command = [promtool, "test", "rules", "test.yml"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def board_expressions(text: str) -> list[str]:
    """Queries of the board's panels."""
    return [target["expr"] for panel in json.loads(text)["panels"] for target in panel["targets"]]


def unknown_series(expressions: list[str]) -> set[str]:
    """Names of series in the expressions that the server does not have."""
    ends = {"counter": ["_total"], "gauge": [""], "histogram": ["_bucket", "_sum", "_count"]}
    known = {PREFIX + name + end for name, metric in METRICS.items() for end in ends[metric.kind]}
    return {name for text in expressions for name in re.findall(rf"{PREFIX}\w+", text)} - known


def test_the_board_asks_for_metrics_that_there_are() -> None:
    assert unknown_series(board_expressions(BOARD)) == set()
    assert unknown_series(board_expressions(BOARD.replace("moves_total", "moves"))) == {PREFIX + "moves"}


def test_prometheus_reads_what_the_board_asks(tmp_path: Path) -> None:
    """Check the expressions as rules with promtool; Grafana fills in the interval."""
    promtool = shutil.which("promtool")
    if promtool is None:
        pytest.skip("promtool (Debian: prometheus) is not installed")
    asked = [text.replace("$__rate_interval", "1m") for text in board_expressions(BOARD)]
    rules = [{"record": f"panel:{number}", "expr": text} for number, text in enumerate(asked)]
    (tmp_path / "board.yml").write_text(json.dumps({"groups": [{"name": "board", "rules": rules}]}), encoding="utf-8")
    command = [promtool, "check", "rules", "board.yml"]
    found = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout + found.stderr


def test_every_rule_has_a_case() -> None:
    named = set(re.findall(r"alert: MeshMotion(\w+)", rules()))
    assert named == {case[0] for case in CASES}


def test_each_rule_speaks_when_it_shall(tmp_path: Path) -> None:
    found = verdict(tmp_path, rules())
    assert found.returncode == 0, found.stdout + found.stderr

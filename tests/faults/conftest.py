"""Rows under pytest: their options, the table that they print, and servers with faults in their processes."""

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from mesh_motion_server.transport.protection import Protection
from mesh_motion_server.watch.terminal.console import working
from tests.faults import table
from tests.faults.check import Check
from tests.faults.in_process import allow_everybody_listed, quiet
from tests.faults.proof import Plan, Proof
from tests.faults.server_process import seeded


def pytest_addoption(parser: pytest.Parser) -> None:
    rows = parser.getgroup("rows", "rows that check the server's promises (-m faults)")
    rows.addoption("--only", action="append", default=[], metavar="NAME", help="run this row; repeatable")
    rows.addoption("--list", action="store_true", help="list the rows with their targets and do nothing")
    rows.addoption("--full", action="store_true", help="use the counts for a night, not for some minutes")
    rows.addoption("--seed", type=int, default=1, metavar="N", help="seed of the random choices")
    rows.addoption("--out", type=Path, default=Path("out/prove"), metavar="DIR", help="folder for proof.json")


def pytest_cmdline_main(config: pytest.Config) -> int | None:
    """Print the list if it is requested; a run needs existing names."""
    known = [check.name for check in table.CHECKS]
    for name in config.getoption("--only"):
        if name not in known:
            raise pytest.UsageError(f"there is no row {name!r}; the rows are {', '.join(known)}")
    if not config.getoption("--list"):
        return None
    plan = _plan(config)
    for check in table.CHECKS:
        sys.stdout.write(f"{check.name:<15} {check.target_of(check.count(plan.scale))}\n")
    return 0


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    only = config.getoption("--only", [])
    left_out = [item for item in items if only and (row := _row(item)) and row.name not in only]
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in left_out]


def pytest_report_teststatus(report: pytest.TestReport) -> tuple[str, str, str] | None:
    return (report.outcome, "", "") if report.when == "call" and "::test_row[" in report.nodeid else None


@pytest.fixture(scope="session")
def proof(request: pytest.FixtureRequest) -> Iterator[Proof]:
    config = request.config
    terminal: Any = config.pluginmanager.get_plugin("terminalreporter")

    def report(line: str) -> None:
        terminal.write_line(line)
        terminal.flush()

    rows = [row for row in map(_row, request.session.items) if row]
    with ExitStack() as shown:
        progress = shown.enter_context(working("")) if sys.stderr.isatty() else lambda _: None
        yield Proof(_plan(config), rows, config.getoption("--out", Path("out/prove")), report=report, progress=progress)


def _plan(config: pytest.Config) -> Plan:
    """Read the options; pytest knows them only if the command line names this folder."""
    scale = "full" if config.getoption("--full", False) else "short"
    return Plan(scale, config.getoption("--seed", 1))


def _row(item: Any) -> Check | None:
    row: Check | None = item.callspec.params["row"] if item.get_closest_marker("faults") else None
    return row


@pytest.fixture
def seed(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Faults by name (tests/faults/seeded/sitecustomize.py) for all servers that start later."""

    def seed(*names: str) -> None:
        for name, value in seeded(*names).items():
            monkeypatch.setenv(name, value)

    return seed


@pytest.fixture
def protection(tmp_path: Path) -> Iterator[Protection]:
    """All users except one, for a server in this process; its log is not printed."""
    with quiet():
        yield allow_everybody_listed(tmp_path)

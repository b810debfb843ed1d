"""The row of attacks: a few attacks, and detection of servers that fail or keep something."""

import os
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from tests.faults import attacked_server
from tests.faults.attacked_server import Target
from tests.faults.check import BrokenPromise
from tests.faults.processes import Usage, descendants, usage_of


def bare_target(pid: int, usage: Usage) -> Any:
    made = object.__new__(Target)
    made.name, made.keys = "of the test", None
    made._process, made._calm = pid, {pid: usage}
    return made


@pytest.fixture
def sleeper() -> Any:
    with subprocess.Popen([sys.executable, "-c", "import sys; sys.stdin.read()"], stdin=subprocess.PIPE) as process:
        yield process
        process.kill()


def test_a_process_that_ends_is_found(sleeper: Any) -> None:
    target = bare_target(sleeper.pid, usage_of(sleeper.pid))
    target.require_alive()
    sleeper.kill()
    sleeper.wait()
    with pytest.raises(BrokenPromise, match="1 processes of the server of the test have ended"):
        target.require_alive()


def test_files_that_are_kept_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(attacked_server, "_PATIENCE", 0.1)
    target = bare_target(os.getpid(), usage_of(os.getpid()))
    assert target.require_calm() < 1 << 20
    kept = os.dup(0)
    with pytest.raises(BrokenPromise, match="gives its descriptors back"):
        target.require_calm()
    os.close(kept)


#: Waits for a line, takes 32 MiB, waits again. A process of its own: this one may reuse memory of earlier tests.
_KEEPER = "import sys; input(); kept = bytearray(b'x') * (32 << 20); print(len(kept), flush=True); input()"


def test_memory_that_is_kept_is_reported() -> None:
    command = [sys.executable, "-c", "print('ready', flush=True);" + _KEEPER]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1) as keeper:
        assert keeper.stdin is not None
        assert keeper.stdout.readline() == "ready\n"
        target = bare_target(keeper.pid, usage_of(keeper.pid))
        keeper.stdin.write("\n")
        assert keeper.stdout.readline() == f"{32 << 20}\n"
        assert target.require_calm() > 20 << 20
        target.remember()
        assert target.require_calm() < 1 << 20
        keeper.kill()


@pytest.mark.parametrize(
    ("attack", "outcome", "said"),
    [
        ("oversized_hello", 300 << 20, "takes 314572800 bytes of a HELLO"),
        ("endless_message", 100 << 20, "of a message without end are taken"),
        ("forged_user", b"..LISTED..", "was believed"),
    ],
)
def test_an_attack_that_works_is_found(monkeypatch: pytest.MonkeyPatch, attack: str, outcome: Any, said: str) -> None:
    harmless = {"oversized_hello": 0, "endless_message": 0, "forged_user": b""} | {attack: outcome}
    for name, value in harmless.items():
        monkeypatch.setattr(attacked_server, name, lambda *arguments, value=value: value)
    monkeypatch.setattr(attacked_server, "_SILENT", 0)
    target: Any = SimpleNamespace(name="of the test", keys=object())
    with pytest.raises(BrokenPromise, match=said):
        attacked_server._single_attacks(target, "tcp://127.0.0.1:9", 1)


def test_processes_are_seen(sleeper: Any) -> None:
    assert {os.getpid(), sleeper.pid} <= descendants(os.getpid())
    assert usage_of(sleeper.pid).files >= 3

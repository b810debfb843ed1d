"""No socket of a test or a client waits for ever: each has limits for sends, receives and its end."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import zmq

from tests.faults.limited_context import limited_context

ROOT = Path(__file__).parents[1]
LIMITS = {"LINGER", "SNDTIMEO", "RCVTIMEO"}
#: Here a context sets them for every socket.
FROM_CONTEXTS = [ROOT / "tests"]
#: Here each function that makes a socket sets them.
BY_THEMSELVES = [ROOT / "adapters", ROOT / "protocol", ROOT / "examples"]
HERE, THE_PLACE = Path(__file__), ROOT / "tests" / "faults" / "limited_context.py"


def sources(folders: list[Path], *endings: str) -> list[Path]:
    found = [path for folder in folders for path in folder.rglob("*") if path.suffix in endings]
    return sorted(path for path in found if path not in (HERE, THE_PLACE))


def contexts_without_limits(text: str) -> Iterator[str]:
    """Lines, also of a program in a string, that make an ordinary context of libzmq; its socket may get the limits
    next.
    """
    lines = text.splitlines()
    for number, line in enumerate(lines):
        made = re.search(r"zmq\.(asyncio\.)?Context(\.instance)?\(", line)
        if made and not {name.lower() for name in LIMITS} <= set(
            re.findall(r"\w+", "\n".join(lines[number : number + 4]))
        ):
            yield line.strip()


def functions_without_limits(text: str) -> Iterator[str]:
    """Functions that make a socket of libzmq and do not set all limits; raw connections without a time limit."""
    for node in ast.walk(ast.parse(text)) if ".socket(zmq." in text else ():
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            source = ast.unparse(node)
            if re.search(r"\.socket\(zmq\.", source) and not set(re.findall(r"\w+", source)) >= LIMITS:
                yield node.name


def connections_without_time(text: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(text)) if "create_connection(" in text else ():
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("create_connection"):
            yield from (
                [] if len(node.args) > 1 or "timeout" in [key.arg for key in node.keywords] else [ast.unparse(node)]
            )


def test_tests_take_their_sockets_from_limited_contexts() -> None:
    found = {path: list(contexts_without_limits(path.read_text("utf-8"))) for path in sources(FROM_CONTEXTS, ".py")}
    assert {path: lines for path, lines in found.items() if lines} == {}


def test_clients_limit_each_socket() -> None:
    found = {path: list(functions_without_limits(path.read_text("utf-8"))) for path in sources(BY_THEMSELVES, ".py")}
    assert {path: names for path, names in found.items() if names} == {}
    compiled = sources(BY_THEMSELVES, ".c", ".h", ".C", ".H", ".cpp", ".hpp", ".f90")
    makers = [path for path in compiled if "zmq_socket(" in path.read_text("utf-8")]
    assert len(makers) >= 2, "the clients in C and for OpenFOAM"
    for path in makers:
        assert {f"ZMQ_{name}" for name in LIMITS} <= set(re.findall(r"\w+", path.read_text("utf-8"))), path


def test_raw_connections_have_a_time() -> None:
    found = {path: list(connections_without_time(path.read_text("utf-8"))) for path in sources(FROM_CONTEXTS, ".py")}
    assert {path: calls for path, calls in found.items() if calls} == {}


@pytest.mark.parametrize(
    ("rule", "source"),
    [
        (contexts_without_limits, "import zmq\ncontext = zmq.Context()\n"),
        (contexts_without_limits, "socket = zmq.Context.instance().socket(zmq.DEALER)\nsocket.linger = 0\n"),
        (functions_without_limits, "def f(c):\n    s = c.socket(zmq.REQ)\n    s.setsockopt(zmq.LINGER, 0)\n"),
        (connections_without_time, "socket.create_connection(('127.0.0.1', 1))"),
    ],
)
def test_the_rules_see_what_they_are_for(rule, source) -> None:
    assert list(rule(source))


def test_a_send_that_nothing_takes_ends() -> None:
    with limited_context(0.05) as context, context.socket(zmq.DEALER) as dealer:
        with pytest.raises(zmq.Again):
            dealer.send(b"to no peer")
        with pytest.raises(zmq.Again):
            dealer.recv()

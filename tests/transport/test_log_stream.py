"""A stream that accepts no line: a pipe without a reader, and writes after it is read again."""

import io
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mesh_motion_server.transport import log_stream
from mesh_motion_server.transport.log_stream import Unfailing

Pipe = tuple[int, Any]


@pytest.fixture
def pipe() -> Iterator[Pipe]:
    reader, writer = os.pipe()
    with os.fdopen(writer, "w") as stream:
        yield reader, stream
    os.close(reader)


def test_a_reader_that_stops_does_not_stop_the_server(pipe: Pipe) -> None:
    reader, stream = pipe
    log = Unfailing(stream)
    line = "x" * 999 + "\n"
    done = threading.Event()

    def write() -> None:
        for _ in range(1000):
            log.write(line)
        log.flush()
        done.set()

    threading.Thread(target=write, daemon=True).start()
    assert done.wait(30), "it waits for a reader"
    taken = os.read(reader, 1 << 20)
    assert 60_000 <= len(taken) <= 1 << 16
    assert set(taken.decode().splitlines(keepends=True)) == {line}
    log.write("again\n")
    assert os.read(reader, 100) == b"again\n"


def test_a_reader_that_is_slow_gets_every_line(pipe: Pipe) -> None:
    reader, stream = pipe
    log, found = Unfailing(stream), bytearray()
    lines = [f"{number} {'y' * 5000}\n" for number in range(100)]

    def read() -> None:
        while len(found) < sum(map(len, lines)):
            time.sleep(0.001)
            found.extend(os.read(reader, 1 << 14))

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    for line in lines:
        log.write(line)
    thread.join(30)
    assert found.decode() == "".join(lines)


def test_a_slow_reader_is_waited_for_once(pipe: Pipe, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_stream, "_PATIENCE_MILLISECONDS", 300)
    log = Unfailing(pipe[1])
    began = time.monotonic()
    for _ in range(200):
        log.write("z" * 4096)
    assert 0.3 <= time.monotonic() - began < 30  # each of them: a minute


def test_a_file_and_what_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with (tmp_path / "log").open("w") as file:
        Unfailing(file).write("a line\n")
    assert (tmp_path / "log").read_text() == "a line\n"
    Unfailing(file).write("to a file that is closed\n")
    Unfailing(file).flush()
    text = io.StringIO()
    Unfailing(text).write("kept\n")
    assert text.getvalue() == "kept\n"
    assert capsys.readouterr().err == ""


def test_a_reader_that_has_gone(pipe: Pipe) -> None:
    reader, stream = pipe
    with open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), reader)
    Unfailing(stream).write("to no reader\n")

"""A page's code blocks as one story: one shell session, in the order of the page.

``sh`` and ``python`` blocks are run, each of the latter in its own process; ``toml`` is checked as a case, a method or
settings; a ``text`` block marked as output is compared with the printed text before it. A comment directly above a
block gives more information::

    <!-- file: NAME -->        the block is saved under this name (and run or compiled by a later block)
    <!-- more of: NAME -->     it is appended to that file
    <!-- fails: N -->          the command ends with this status
    <!-- output -->            of a text block: these lines were printed by the block before, … stands for anything
    <!-- run by: PATH -->      another test runs it
    <!-- not run: REASON -->   it cannot be run here
"""

import os
import re
import signal
import socket
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from docs.site.reference import without_parts
from mesh_motion_server.cases.case import CaseFile
from mesh_motion_server.settings import MethodSettings, ServerSettings

ROOT = Path(__file__).resolve().parents[2]
#: Languages whose blocks must be run, or give a reason.
LANGUAGES = ("python", "sh", "bash", "toml", "c")
MARKS = ("file", "more of", "fails", "output", "run by", "not run")
#: Folders of the checkout that a reader has in addition to the page's own files.
_FOLDERS = ("examples", "adapters", "docs", "protocol")
_END = "END_OF_THE_BLOCK"
_BLOCK = re.compile(
    r"(?:^[ ]*<!-- (?P<mark>[a-z ]+?)(?:: (?P<value>[^>]+?))? -->\n)?"
    r"^(?P<indent>[ ]*)```(?P<language>\w*)\n(?P<text>.*?)^[ ]*```$",
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, the information in the comment above it, and its text."""

    line: int
    language: str
    mark: str
    value: str
    text: str


def blocks_of(page: str) -> list[Block]:
    """Every block that is run, checked, or has a mark; generated parts have their own tests."""
    page, found = without_parts(page), []
    for match in _BLOCK.finditer(page):
        mark = match["mark"] if match["mark"] in MARKS else ""
        indent = len(match["indent"])
        text = "".join(line[indent:] if line.strip() else line for line in match["text"].splitlines(keepends=True))
        if match["language"] in LANGUAGES or mark:
            line = page.count("\n", 0, match.start("indent")) + 1
            found.append(Block(line, match["language"], mark, match["value"] or "", text))
    return found


def steps_of(blocks: list[Block]) -> list[Block]:
    return [block for block in blocks if block.mark not in ("not run", "run by")]


def play(blocks: list[Block], folder: Path) -> list[str]:
    """Play a page's story in a folder; return one line for each difference from the page."""
    story = steps_of(blocks)
    wrong = [fault for block in story for fault in _unreadable(block)]
    if wrong or not any(_runs(block) for block in story):
        return wrong
    done = _run(_script(story), folder)
    printed = _printed(done.stdout)
    if done.returncode:
        last = max(printed, default=0)
        return [f"line {last}: status {done.returncode}\n{printed.get(last, '')[-3000:]}"]
    return list(_differences(story, printed))


def _runs(block: Block) -> bool:
    return block.language in ("sh", "bash") or (block.language == "python" and not block.mark.endswith(("file", "of")))


def _unreadable(block: Block) -> Iterator[str]:
    """Errors of a block that are found without running it."""
    if block.language == "c" and block.mark not in ("file", "more of"):
        yield f"line {block.line}: C is compiled from a file; say which"
    if block.language == "toml" and not block.value.startswith("session"):
        try:
            _check_toml(block.text)
        except Exception as error:
            yield f"line {block.line}: {error}"


def _check_toml(text: str) -> None:
    """A case file, its ``[method]``, or a server's settings."""
    values = tomllib.loads(text)
    if "mesh" in values:
        CaseFile.model_validate(values)
    elif set(values) == {"method"}:
        MethodSettings.from_mapping(values["method"])
    else:
        ServerSettings.from_mapping(values)


def _script(story: list[Block]) -> str:
    """The shell session; the output of a block comes after a line with the block's number."""
    lines = ["set -e", "trap 'trap : TERM; kill -TERM 0' EXIT"]
    for block in story:
        if block.mark in ("file", "more of"):
            sign = ">" if block.mark == "file" else ">>"
            lines.append(f"cat {sign} {block.value} <<'{_END}'\n{block.text}{_END}")
        elif _runs(block):
            lines.append(f"printf '\\036%d\\n' {block.line}")
            lines.append(_command(block))
    return "\n".join(lines) + "\n"


def _command(block: Block) -> str:
    text = block.text if block.language != "python" else f"python - <<'{_END}'\n{block.text}{_END}\n"
    if block.mark == "fails":
        return f"status=0\n(\n{text}) || status=$?\n[ $status = {block.value} ]"
    return text


def _run(script: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run it in a folder with the checkout's folders, a separate home, and free addresses."""
    for name, module in (("mesh-motion", " -m mesh_motion_server"), ("dask", " -m dask"), ("python", "")):
        program = folder / "bin" / name
        program.parent.mkdir(exist_ok=True)
        program.write_text(f'#!/bin/sh\nexec {sys.executable}{module} "$@"\n')
        program.chmod(0o755)
    for name in _FOLDERS:
        (folder / name).symlink_to(ROOT / name)
    for port in ("7440", "9464", "8080"):
        script = script.replace(f"127.0.0.1:{port}", f"127.0.0.1:{free_port()}")
    environment = os.environ | {"PATH": f"{folder / 'bin'}:{os.environ['PATH']}", "HOME": str(folder), "COLUMNS": "120"}
    environment.pop("PYTHONUNBUFFERED", None)  # with it, lines of two processes may be joined
    session = subprocess.Popen(
        ["sh", "-c", script],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        printed, _ = session.communicate(timeout=240)
    finally:
        _end(session)
    return subprocess.CompletedProcess(session.args, session.returncode, printed)


def _end(session: subprocess.Popen[str]) -> None:
    """End all processes that the story has left running."""
    try:
        os.killpg(session.pid, signal.SIGKILL)
    except ProcessLookupError:
        return
    session.wait()


def free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


def _printed(output: str) -> dict[int, str]:
    parts = output.split("\036")[1:]
    return {int(number): text for number, _, text in (part.partition("\n") for part in parts)}


def _differences(story: list[Block], printed: dict[int, str]) -> Iterator[str]:
    """Lines of the page that were not printed, in this order."""
    before = 0
    for block in story:
        if block.line in printed:
            before = block.line
        if block.mark == "output":
            rest = [_plain(line) for line in printed.get(before, "").splitlines()]
            for line in filter(None, map(_plain, block.text.splitlines())):
                wanted = re.compile(".*".join(map(re.escape, line.split("…"))))
                at = next((i for i, got in enumerate(rest) if wanted.fullmatch(got)), None)
                if at is None:
                    yield f"line {block.line}: not printed: {line}\ngot:\n{printed.get(before, '')[-3000:]}"
                    break
                rest = rest[at + 1 :]


def _plain(line: str) -> str:
    return " ".join(line.split())

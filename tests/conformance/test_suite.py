"""The suite itself: it is made from the document, its cases have the document's names, and its report is readable."""

import ast
import re
import socket
import subprocess
import sys
from pathlib import Path

import msgpack
import pytest
import zmq
from mesh_motion_conformance.__main__ import main
from mesh_motion_conformance.case import Case, Outcome, Skip, Unmet
from mesh_motion_conformance.client import client_cases
from mesh_motion_conformance.line import Silence
from mesh_motion_conformance.presence import Unreachable, require_somebody
from mesh_motion_conformance.report import line_of, summary
from mesh_motion_conformance.runner import run, selected
from mesh_motion_conformance.server import server_cases
from mesh_motion_conformance.show import show_frames
from mesh_motion_conformance.spec_tables import TABLES, read_spec, rendered

from tests.faults.limited_context import limited_context

ROOT = Path(__file__).resolve().parents[2]
SPEC = ROOT / "protocol" / "SPEC.md"
README = ROOT / "protocol" / "conformance" / "README.md"


def titles_of_the_document():
    """Section → its title."""
    return dict(re.findall(r"^## (\d+) (.+)$", SPEC.read_text(encoding="utf-8"), re.MULTILINE))


def test_the_summary_names_sections_as_the_document_does():
    titles = titles_of_the_document()
    for case in (*server_cases(), *client_cases()):
        section = case.section.partition(".")[0]
        assert f"{section} {titles[section]} " in summary([Outcome(case, "PASS", 0.0)])


def test_the_tables_are_those_of_the_document():
    assert rendered(read_spec(SPEC.read_text(encoding="utf-8"))) == TABLES.read_text(encoding="utf-8"), (
        "run python protocol/render_spec.py"
    )


@pytest.mark.parametrize("cases", [server_cases(), client_cases()], ids=["server", "client"])
def test_every_case_is_named_by_a_sentence_of_the_document(cases):
    ids = [case.id for case in cases]
    assert len(set(ids)) == len(ids)
    text = SPEC.read_text(encoding="utf-8")
    for case in cases:
        section, _, sentence = case.section.partition(".")
        part = re.search(rf"^## {section} .*?(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
        assert part, case.id
        assert not sentence or re.search(rf"^{sentence}\. ", part[0], re.MULTILINE), case.id
        assert case.demand, case.id


def test_there_are_as_many_cases_as_the_readme_says():
    said = re.findall(r"[Mm]ore than (\d+) (?:cases|scenarios)", README.read_text(encoding="utf-8"))
    assert len(said) == 2
    assert len(server_cases()) > int(said[0])
    assert len(client_cases()) > int(said[1])


def test_it_imports_neither_the_server_nor_what_computes():
    code = "import mesh_motion_conformance.command, sys; print(*sys.modules)"
    paths = [str(ROOT / "protocol" / "conformance")]
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path[:0] = {paths!r}; {code}"],
        capture_output=True,
        text=True,
        check=True,
    )
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert not loaded & {
        "mesh_motion_server",
        "mesh_motion_client",
        "mesh_motion_kernels",
        "scipy",
        "pydantic",
        "typer",
    }
    assert not any(name.startswith("mesh_motion_protocol.codec") for name in done.stdout.split())


def test_no_case_is_made_from_the_implementation():
    folder = ROOT / "protocol" / "conformance" / "mesh_motion_conformance"
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not [n for n in names if n.startswith(("mesh_motion_protocol", "mesh_motion_client"))], path


class Plain:
    sent = "PING #1 {}"

    def between(self):
        pass

    def mend(self):
        pass


def case(section, name, run=lambda stage: None):
    return Case(section, name, "a demand", run)


def raising(error):
    def run(stage):
        raise error

    return run


def test_outcomes_and_their_lines():
    cases = [
        case("2.1", "good"),
        case("2.2", "bad", raising(Unmet("PONG", "ERROR #1 {}"))),
        case("10", "odd", raising(KeyError("step"))),
        case("10", "skipped", raising(Skip("no disk to break"))),
    ]
    outcomes = run(cases, Plain())
    assert [outcome.verdict for outcome in outcomes] == ["PASS", "FAIL", "FAIL", "SKIP"]
    text = line_of(outcomes[1])
    assert text.splitlines()[0] == "FAIL 2.2-bad: a demand"
    assert [line.split()[0] for line in text.splitlines()[1:]] == ["sent", "expected", "got"]
    assert "no disk to break" in line_of(outcomes[3])
    assert [row.split()[0] for row in summary(outcomes).splitlines()] == ["2", "10", "all,"]


@pytest.mark.parametrize(
    ("only", "ids"),
    [
        ([], ["1-a", "10-b", "10.2-c", "10.20-d"]),
        (["10"], ["10-b", "10.2-c", "10.20-d"]),
        (["10.2"], ["10.2-c"]),
        (["10.2-c", "1"], ["1-a", "10.2-c"]),
        (["9"], []),
    ],
)
def test_selection(only, ids):
    cases = [case("1", "a"), case("10", "b"), case("10.2", "c"), case("10.20", "d")]
    assert [c.id for c in selected(cases, only)] == ids


def test_a_server_that_falls_silent_does_not_take_all_day():
    silent = [case("2", f"number-{n}", raising(Silence("no reply"))) for n in range(40)]
    outcomes: list[Outcome] = run(silent, Plain())
    assert [o.verdict for o in outcomes] == ["FAIL"] * 10 + ["SKIP"] * 30


def test_command_lists_cases(capsys):
    assert main(["--endpoint", "tcp://127.0.0.1:1", "--list", "--only", "16"]) == 0
    assert all(line.startswith("16-") for line in capsys.readouterr().out.splitlines())


@pytest.mark.parametrize("arguments", [[], ["--only", "7"]])
def test_command_without_anybody_there_says_so_at_once_and_ends_with_69(capsys, arguments):
    assert main(["--endpoint", "tcp://127.0.0.1:1", "--timeout", "600", *arguments]) == 69
    output = capsys.readouterr()
    assert output.err == "mesh_motion_conformance: no server listens at tcp://127.0.0.1:1\n"
    assert output.out == ""


def test_a_listener_without_a_greeting_is_not_a_server():
    with socket.create_server(("127.0.0.1", 0)) as silent:
        endpoint = "tcp://{}:{}".format(*silent.getsockname())
        with pytest.raises(Unreachable, match="answers a ZMTP greeting"):
            require_somebody(endpoint, 0.3)


def test_a_wrong_endpoint_is_refused():
    with pytest.raises(Unreachable, match="tcp://HOST:PORT"):
        require_somebody("http://127.0.0.1", 0.3)


def test_a_server_with_keys_is_recognised():
    with limited_context() as context, context.socket(zmq.ROUTER) as router:
        router.curve_server, router.curve_secretkey = True, zmq.curve_keypair()[1]
        port = router.bind_to_random_port("tcp://127.0.0.1")
        with pytest.raises(Unreachable, match="asks for keys"):
            require_somebody(f"tcp://127.0.0.1:{port}", 30.0)


def test_frames_are_shown_without_control_characters():
    header = msgpack.packb({"type": "\x1b[2J", "\x9bx": "\x07"})
    shown = show_frames([header])
    assert shown.isprintable()
    assert "\\x1b[2J" in shown


def test_a_listener_with_a_greeting_is_a_server():
    with limited_context() as context, context.socket(zmq.ROUTER) as router:
        require_somebody(f"tcp://127.0.0.1:{router.bind_to_random_port('tcp://127.0.0.1')}", 30.0)

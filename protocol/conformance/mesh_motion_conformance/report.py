"""Results of a run: lines for people, JSON, JUnit XML."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from mesh_motion_conformance.case import Outcome, section_order

__all__ = ["line_of", "summary", "write_json", "write_junit"]

_TITLES = {
    "2": "Transport", "3": "Frames", "4": "Header", "5": "Arrays", "6": "Limits", "7": "A session", "8": "States",
    "9": "Partitions", "10": "Exactly once", "11": "Broken connections, RESUME, fencing", "12": "Messages",
    "13": "Mesh", "14": "Settings", "15": "Reports", "16": "The committed state's digest", "17": "Errors",
    "18": "Versions", "19": "A minimal client", "20": "Keys and roles", "21": "Durability",
    "22": "Shared memory", "23": "Evaluation by the client", "24": "Derivatives", "25": "Velocities and swept volumes",
}  # fmt: skip


def line_of(outcome: Outcome) -> str:
    """One line; for a failure three more with the sent, expected and received message."""
    case = outcome.case
    head = f"{outcome.verdict} {case.id}: {case.demand}"
    if outcome.verdict == "SKIP":
        return f"{head} ({outcome.got})"
    if outcome.verdict == "PASS":
        return head
    rows = [("sent", outcome.sent), ("expected", outcome.expected), ("got", outcome.got)]
    return "\n".join([head, *(f"     {name:8} {text}" for name, text in rows if text)])


def summary(outcomes: Sequence[Outcome]) -> str:
    """A line for each section, and the total."""
    counts: dict[str, Counter[str]] = {}
    for outcome in outcomes:
        counts.setdefault(outcome.case.section.partition(".")[0], Counter())[outcome.verdict] += 1
    rows = [
        _row(f"{section:>2} {_TITLES.get(section, '')}", counts[section])
        for section in sorted(counts, key=section_order)
    ]
    seconds = sum(outcome.seconds for outcome in outcomes)
    total = sum(counts.values(), Counter())
    return "\n".join([*rows, _row(f"all, {seconds:.1f} s", total)])


def _row(title: str, count: Counter[str]) -> str:
    return f"{title:42} {count['PASS']:5} passed {count['FAIL']:5} failed {count['SKIP']:5} skipped"


def write_json(path: Path, outcomes: Sequence[Outcome], subject: str) -> None:
    """The whole report for programs."""
    counts = Counter(outcome.verdict for outcome in outcomes)
    cases = [
        {"id": o.case.id, "section": o.case.section, "demand": o.case.demand, "verdict": o.verdict,
         "seconds": round(o.seconds, 4), "expected": o.expected, "got": o.got, "sent": o.sent}
        for o in outcomes
    ]  # fmt: skip
    report = {"subject": subject, "passed": counts["PASS"], "failed": counts["FAIL"], "skipped": counts["SKIP"]}
    path.write_text(json.dumps(report | {"cases": cases}, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def write_junit(path: Path, outcomes: Sequence[Outcome]) -> None:
    """The report as JUnit XML for continuous integration."""
    suite = ElementTree.Element("testsuite", name="mesh-motion conformance", tests=str(len(outcomes)))
    for outcome in outcomes:
        section = outcome.case.section.partition(".")[0]
        place = {"classname": f"section {section}", "name": outcome.case.id, "time": f"{outcome.seconds:.4f}"}
        element = ElementTree.SubElement(suite, "testcase", place)
        if outcome.verdict == "FAIL":
            ElementTree.SubElement(element, "failure", message=f"expected {outcome.expected}, got {outcome.got}")
        elif outcome.verdict == "SKIP":
            ElementTree.SubElement(element, "skipped", message=outcome.got)
    ElementTree.ElementTree(suite).write(path, encoding="utf-8", xml_declaration=True)

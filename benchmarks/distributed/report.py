"""The results as tables of docs/distributed.md."""

from __future__ import annotations

from pathlib import Path

from benchmarks.distributed.figures import Results, Row
from benchmarks.distributed.model import CostModel
from benchmarks.page import fill_block

__all__ = ["PAGE", "fill", "tables"]

PAGE = Path(__file__).parents[2] / "docs" / "distributed.md"

#: Nodes, boundary nodes and workers that the page predicts.
PREDICTED = (
    (1e8, 1e6, 100),
    (1e8, 1e6, 1000),
    (1e9, 1e6, 1000),
    (1e9, 3e6, 1000),
    (1e9, 1e7, 1000),
    (1e9, 3e6, 10_000),
)

_STEPS = (
    "| mesh | workers | what comes back | processor time here, ms | of it solve | busiest worker | all workers | wall "
    "| halo | largest difference |\n|---|---:|---|" + "---:|" * 7 + "\n"
)
_WIRE = (
    "| mesh | workers | what comes back | coefficients | positions | questions | displacements | summaries "
    "| questions asked |\n|---|---:|---|" + "---:|" * 6 + "\n"
)
_BACK = {"one machine": "–", "session": "displacements", "partitions": "summaries"}


def tables(results: Results) -> dict[str, str]:
    """By the name of the block."""
    rows = sorted(results.rows, key=lambda row: (row.nodes, row.case, row.workers, row.way))
    wire = [row for row in rows if row.workers]
    model = CostModel.of(results)
    return {
        "distributed-steps": f"{_STEPS}{''.join(map(_step, rows))}\n{results.machine}\n",
        "distributed-wire": f"{_WIRE}{''.join(map(_bytes, wire))}",
        "distributed-constants": _constants(model, results),
        "distributed-prediction": _prediction(model),
    }


def fill(results: Results) -> None:
    """Put the tables into the page."""
    for name, text in tables(results).items():
        fill_block(name, text, PAGE)


def _step(row: Row) -> str:
    longest, every = (f"{1e3 * s:.0f}" if row.workers else "–" for s in (row.longest, row.all_workers))
    # on one machine and in a session the phases are known in wall time only
    solve = f"{1e3 * row.solve:.0f}" if row.way == "partitions" else "–"
    halo = f"{100 * row.halo:.1f} %" if row.way == "partitions" else "–"
    difference = f"{row.difference:.0e}" if row.difference else "0"
    return (
        f"| {row.case} | {row.workers or '–'} | {_BACK[row.way]} | {1e3 * row.here:.0f} | {solve} | {longest} "
        f"| {every} | {1e3 * row.wall:.0f} | {halo} | {difference if row.workers else '–'} |\n"
    )


def _bytes(row: Row) -> str:
    sent = (_size(row.sent.get(kind, 0)) for kind in ("coefficients", "positions", "questions"))
    received = (_size(row.received.get(kind, 0)) for kind in ("displacements", "summaries"))
    return f"| {row.case} | {row.workers} | {_BACK[row.way]} | {' | '.join((*sent, *received))} | {row.rounds} |\n"


def _size(count: float) -> str:
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= factor:
            return f"{count / factor:.3g} {unit}"
    return f"{count:.0f} B" if count else "0"


def _constants(model: CostModel, results: Results) -> str:
    lines = [
        ("a", "solve, whatever the boundary", f"{1e3 * model.solve_fixed:.0f} ms"),
        ("b", "solve, for each boundary node", f"{1e6 * model.solve_per_node:.2f} µs"),
        ("l", "an empty question to one partition", f"{1e3 * model.round_trip:.1f} ms"),
        ("τ", "each further partition asked", f"{1e3 * model.per_task:.2f} ms"),
        ("rounds", "questions of a step", f"{model.rounds}"),
        ("β", "sent for each boundary node", f"{model.bytes_per_node:.0f} B"),
        ("γ", "sent for each partition", _size(model.bytes_per_partition)),
        ("c", "moving a node and judging its cells", f"{1e6 * model.volume_per_node:.2f} µs"),
        ("k", "halo, h = k (N / P)^(−1/3)", f"{model.halo:.2f}"),
        ("–", "loopback, worker to server", f"{results.bandwidth / 1e9:.2g} GB/s"),
    ]
    return "| | what | measured |\n|---|---|---:|\n" + "".join(f"| {a} | {b} | {c} |\n" for a, b, c in lines)


def _prediction(model: CostModel) -> str:
    head = "| nodes | boundary nodes | workers | solve | messages | wire | volume | step |\n|" + "---:|" * 8 + "\n"
    return head + "".join(_predicted(model, *case) for case in PREDICTED)


def _predicted(model: CostModel, nodes: float, boundary: float, workers: int) -> str:
    terms = model.terms(nodes, boundary, workers)
    seconds = (terms.solve, terms.messages, terms.wire, terms.volume, terms.total)
    return f"| {nodes:.0e} | {boundary:.0e} | {workers} | {' | '.join(f'{s:.2g} s' for s in seconds)} |\n"

"""Made-up histories of sessions, as long as a test needs them, and the same each time."""

import json
import math
import random
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

#: Start of the made-up session, Unix time.
BEGIN = 1_790_000_000.0
_SETTINGS = {"basis": "wendland-c2", "correction": "optimised", "quality_metric": "size-skew", "quality_threshold": 0.2}


def made_up_events(steps: int, *, seed: int = 0, dimension: int = 2, iterations: int = 2) -> Iterator[dict[str, Any]]:
    """The events of a session with this many steps.

    Its quality falls and recovers slowly (in a period of 500 steps), is corrected if it is below 0.2, and is lowest in
    one step of each period. Every 97th step has a refusal and a rolled-back trial, every 1000th step a resumption.
    """
    chance, at = random.Random(seed), BEGIN
    yield {
        "at": at,
        "event": "built",
        "nodes": 400,
        "cells": {"triangle": 722},
        "patches": {"flap": {"role": "moving", "nodes": 40}, "walls": {"role": "fixed", "nodes": 76}},
        "moving_nodes": 40,
        "box": [[0.0] * dimension, [1.0] * dimension],
        "warnings": [],
        "settings": _SETTINGS,
        "quality": _summary(0.9, chance, dimension),
        "seconds_total": 0.05,
        "version": "0.0.0",
        "maker": "made up",
    }
    epoch = 1
    for step in range(1, steps + 1):
        of_step = []
        if step % 1000 == 0:
            epoch += 1
            of_step.append(
                {"event": "resumed", "step": step - 1, "epoch": epoch, "version": "0.0.0", "maker": "made up"}
            )
        if step % 97 == 0:
            of_step.append(_moved(step, 1, chance, dimension))
            of_step.append({"event": "rolled_back", "step": step, "iteration": 1})
            of_step.append(refused(step))
        of_step += [_moved(step, iteration, chance, dimension) for iteration in range(1, iterations + 1)]
        of_step[-1]["faces"] = {"before": _faces(24.5), "after": _faces(largest_angle(step))}
        of_step.append(_committed(step, chance, dimension))
        for event in of_step:
            at += 0.05
            yield {"at": at, **event}


def write_history(session_folder: Path, steps: int, *, segments: int = 1, **options: Any) -> list[dict[str, Any]]:
    folder = session_folder / "history"
    folder.mkdir(parents=True, mode=0o700)
    events = list(made_up_events(steps, **options))
    length = math.ceil(len(events) / segments)
    for number in range(segments):
        lines = [json.dumps(event) + "\n" for event in events[number * length : (number + 1) * length]]
        (folder / f"events-{number:08}.jsonl").write_text("".join(lines), encoding="utf-8")
    return events


def put_events(session_folder: Path, events: Iterable[dict[str, Any]], number: int = 0) -> Path:
    folder = session_folder / "history"
    folder.mkdir(parents=True, exist_ok=True)
    text = "".join(json.dumps(event) + "\n" for event in events)
    (folder / f"events-{number:08}.jsonl").write_text(text, encoding="utf-8")
    return session_folder


def resumed_at(step: int, at: float = BEGIN + 1e6) -> dict[str, Any]:
    return {"at": at, "event": "resumed", "step": step, "epoch": 2, "version": "0.0.0", "maker": "made up"}


def go_on(folder: Path, steps: int, more: int) -> None:
    segment = max((folder / "history").glob("events-*.jsonl"))
    with segment.open("a", encoding="utf-8") as file:
        for event in made_up_events(steps + more):
            if event.get("step", 0) > steps:
                file.write(json.dumps(event | {"at": time.time()}) + "\n")


def lowest_quality(step: int) -> float:
    """The minimum quality of the made-up motion without a correction."""
    return 0.45 + 0.3 * math.cos(2 * math.pi * step / 500) - (0.1 if step % 500 == 250 else 0.0)


def largest_angle(step: int) -> float:
    return 90.0 - 60.0 * lowest_quality(step)


def _faces(angle: float) -> dict[str, Any]:
    above = {f"faces_above_{limit}": int(max(0.0, angle - limit)) for limit in (65, 75)}
    shares = {"max_skewness": 0.5, "min_volume_ratio": 0.25, "shortest_edge": 0.5, "smallest_face": 0.375}
    return {"faces": 1050, "max_non_orthogonality": angle, **above, **shares}


def _summary(lowest: float, chance: random.Random, dimension: int) -> dict[str, Any]:
    spread = {name: lowest + part * (1.0 - lowest) for name, part in (("p1", 0.2), ("p5", 0.4), ("p50", 0.7))}
    values = {"min": lowest, "mean": lowest + 0.65 * (1.0 - lowest), **spread}
    worst = []
    for number in range(10):
        metric = lowest + 0.01 * number
        place = {"partition": 0, "type": "triangle", "cell": chance.randrange(722)}
        centre = [round(chance.random(), 3) for _ in range(dimension)]
        worst.append(place | {"centre": centre, "size": 0.8, "skew": metric, "size_skew": metric, "metric": metric})
    return {
        **dict.fromkeys(("size", "skew", "size_skew", "metric"), values),
        "inverted": int(lowest <= 0),
        "cells": 722,
        "worst": worst,
    }


def _moved(step: int, iteration: int, chance: random.Random, dimension: int) -> dict[str, Any]:
    lowest = lowest_quality(step)
    corrects = lowest < _SETTINGS["quality_threshold"]
    points = [[round(chance.random(), 3) for _ in range(dimension)] for _ in range(3 if corrects else 0)]
    return {
        "event": "moved",
        "step": step,
        "iteration": iteration,
        "quality": {
            "metric": _SETTINGS["quality_metric"],
            "threshold": _SETTINGS["quality_threshold"],
            "standard": _summary(lowest, chance, dimension),
            "corrected": _summary(max(lowest, 0.21) if corrects else lowest, chance, dimension),
        },
        "correction": {
            "method": "optimised" if corrects else "none",
            "enrichment_points": len(points),
            "freed_nodes": 12 if corrects else 0,
            "iterations": 4 if corrects else 0,
            "reached": True,
            "control_points": 116,
            "support_radius": 0.5,
            "sub_steps": 1,
        },
        "caches": {"factorization": "made" if iteration == 1 else "reused"},
        "seconds": {"solve": 0.001, "predict": 0.002, "correct": 0.01 * corrects, "displace": 0.001, "total": 0.014},
        "seconds_total": 0.015 + 0.01 * corrects,
        "warnings": ["a cell is nearly flat"] if step % 100 == 0 and iteration == 1 else [],
        "enrichment_points": points,
    }


def _committed(step: int, chance: random.Random, dimension: int) -> dict[str, Any]:
    quality = _summary(max(lowest_quality(step), 0.205), chance, dimension)
    return {"event": "committed", "step": step, "quality": quality, "digest": f"{step:064x}", "seconds_total": 0.001}


def refused(step: int, message: str = "no valid mesh found: 3 of 722 cells are inverted") -> dict[str, Any]:
    return {
        "event": "refused",
        "request": "MOVE",
        "step": step,
        "code": "FAILED_PRECONDITION.QUALITY",
        "message": message,
        "hint": "move the fraction that stays valid, in smaller steps",
        "details": {"best": -0.2, "fraction": 0.5, "worst": [{"partition": 0, "type": "triangle", "cell": 7}]},
    }

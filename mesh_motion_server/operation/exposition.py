"""The metrics in Prometheus' text format, from the plain values that the supervisor sends."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import accumulate
from typing import Any

from prometheus_client import CollectorRegistry
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    Metric,
)
from prometheus_client.exposition import generate_latest
from prometheus_client.registry import Collector

from mesh_motion_server.operation.metrics import METRICS, PREFIX
from mesh_motion_server.operation.metrics import Metric as Line
from mesh_motion_server.operation.tally import Tally

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"


class _Collector(Collector):
    """The metrics of the table with their current values."""

    def __init__(self, totals: Tally, gauges: dict[tuple[str, str], float], build: dict[str, str]) -> None:
        self._totals, self._gauges, self._build = totals, gauges, build

    def collect(self) -> Iterator[Metric]:
        """See prometheus_client."""
        yield InfoMetricFamily(PREFIX + "build", "Versions of this server.", value=self._build)
        for line in METRICS.values():
            yield self._family(line)

    def _family(self, line: Line) -> Metric:
        if line.kind == "histogram":
            return _histogram(line, self._totals.spreads.get(line.name))
        labels = [line.label] if line.label else []
        family: CounterMetricFamily | GaugeMetricFamily
        if line.kind == "counter":
            family, values = CounterMetricFamily(PREFIX + line.name, line.text, labels=labels), self._totals.counts
        else:
            family, values = GaugeMetricFamily(PREFIX + line.name, line.text, labels=labels), self._gauges
        if labels:
            shown = dict.fromkeys(line.shown, 0.0) | {
                label: v for (name, label), v in values.items() if name == line.name
            }
            for label, value in sorted(shown.items()):
                family.add_metric([label], value)
        elif line.kind == "counter" or (line.name, "") in values:
            family.add_metric([], values.get((line.name, ""), 0))
        return family


def _histogram(line: Line, spread: list[float] | None) -> HistogramMetricFamily:
    """Return cumulative buckets, as Prometheus requires."""
    *numbers, total = spread or [0.0] * (len(line.bounds) + 2)
    ends = [*(repr(float(bound)) for bound in line.bounds), "+Inf"]
    family = HistogramMetricFamily(PREFIX + line.name, line.text)
    family.add_metric([], buckets=list(zip(ends, accumulate(numbers), strict=True)), sum_value=total)
    return family


def exposition(totals: dict[str, Any], gauges: Iterable[tuple[str, str, float]], build: dict[str, str]) -> bytes:
    """Return the page with the current values.

    Parameters
    ----------
    totals : dict
        The content of the supervisor's tally, as :meth:`.Tally.take` returns it.
    gauges : iterable of (name, label, value)
    build : dict
        Labels of build_info.
    """
    tally = Tally()
    tally.add(totals)
    registry = CollectorRegistry()
    registry.register(_Collector(tally, {(name, label): value for name, label, value in gauges}, build))
    return generate_latest(registry)

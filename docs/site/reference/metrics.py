"""The metrics, from the table that the server uses for counting."""

from __future__ import annotations

from docs.site.reference.tables import code, table
from mesh_motion_server.operation.metrics import METRICS, PREFIX

__all__ = ["metrics"]


def metrics() -> str:
    """Each metric as Prometheus sees it."""
    rows = []
    for metric in METRICS.values():
        name = f"{PREFIX}{metric.name}{'_total' if metric.kind == 'counter' else ''}"
        rows.append((code(name), metric.kind, code(metric.label), metric.text))
    return table(("metric", "kind", "label", "says"), rows)

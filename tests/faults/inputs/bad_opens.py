"""OPEN with invalid values: fields and settings outside their ranges."""

import math
from typing import Any

from tests.faults.inputs.cases import BadInput, Names, Rng, spoilt, unfit
from tests.faults.inputs.drafts import Draft

_HEADER, _VALUE = "INVALID_ARGUMENT.HEADER", "INVALID_ARGUMENT.VALUE"
_SETTINGS, _NONFINITE = "INVALID_ARGUMENT.SETTINGS", "INVALID_ARGUMENT.NONFINITE"


def _field(key: str, value: Any, code: str, *says: str) -> BadInput:
    def spoil(draft: Draft, rng: Rng) -> Names:
        draft.opening[key] = value
        return {"field": key}

    return BadInput(f"OPEN with {key} = {_short(value)}", "open", spoil, code, (key, *says))


def _setting(key: str, value: Any) -> BadInput:
    """A setting with a bad value; the decoder refuses values that are not numbers."""
    wild = isinstance(value, float) and not math.isfinite(value)

    def spoil(draft: Draft, rng: Rng) -> Names:
        draft.set_settings(**{key: value})
        return {"field": f"settings.{key}"} if wild else {"setting": key, "value": repr(value)}

    says = (key, str(value)) if wild else (key, repr(value))
    return BadInput(f"setting {key} = {_short(value)}", "open", spoil, _NONFINITE if wild else _SETTINGS, says)


def _short(value: Any) -> str:
    return repr(value) if len(repr(value)) <= 24 else f"{repr(value)[:20]}…"


def _at_client(draft: Draft) -> None:
    draft.opening["evaluation"] = "client"
    draft.set_settings(displacement="absolute", correction="enrichment")


BAD_OPENS = (
    *(_field("dimension", value, _VALUE, str(value)) for value in (0, 4, -1)),
    *(_field("dimension", value, _HEADER) for value in (2.0, math.nan, True, "2", None, 2**63)),
    spoilt("OPEN without dimension", "open", _HEADER, lambda draft: draft.opening.pop("dimension"),
           {"field": "dimension"}, "dimension", "missing"),
    *(_field("partitions", value, _VALUE, str(value)) for value in (0, -1, 257)),
    _field("partitions", 5, _VALUE, "at most 4", "5"),
    _field("bytes_reserved", -1, _VALUE, "-1"),
    _field("bytes_reserved", 1 << 40, "RESOURCE_EXHAUSTED.BYTES", str(1 << 40)),
    _field("label", "x" * 41, _VALUE, "41"),
    _field("label", "y" * 257, _VALUE),
    _field("durability", "none", _VALUE, "none"),
    _field("durability", "relaxed", _VALUE, "relaxed"),
    _field("evaluation", "both", _VALUE, "both"),
    spoilt("evaluation = client with enrichment", "open", _SETTINGS, _at_client, {"setting": "correction"},
           "evaluation", "correction"),
    _field("settings", [], _HEADER),
    spoilt("an unknown setting", "open", _SETTINGS, lambda draft: draft.set_settings(radius=1.0),
           {"setting": "radius"}, "radius", "support_radius"),
    *(_setting("support_radius", value) for value in (0, 0.0, -1.0, -5e-324, "1", True, math.nan, math.inf)),
    _setting("enrichment_radius", -1e-300),
    *(_setting("quality_threshold", value) for value in (1.5, -1.0000001, math.nan, -math.inf, None)),
    *(_setting("max_enrichment_points", value) for value in (-1, 2**40, 2.5)),
    _setting("enrichment_radius", -0.0),
    *(_setting("basis", value) for value in ("wendland-c3", "", 2, "qb")),
    *(_setting("reduction", value) for value in ("cholesky", None)),
    *(_setting("sub_steps", value) for value in ("always", True)),
    *(_setting("correction_target", value) for value in ("auto", 2)),
    *(_setting("allow_invalid", value) for value in (1, "yes")),
    _setting("correction", ["optimised"]),
    _setting("displacement", "RELATIVE"),
    unfit("open", "reduction", reduction="greedy", basis="tps"),
    unfit("open", "correction", correction="smooth", displacement="relative"),
)  # fmt: skip

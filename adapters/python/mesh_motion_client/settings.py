"""The settings of a session as types: an editor completes the keys, a type checker finds a wrong one.

The keys are those of the case file's ``[method]``; docs/method.md describes each key. A test compares the keys with
that page.
"""

from __future__ import annotations

from typing import Literal, TypedDict

__all__ = ["Settings"]


class Settings(TypedDict, total=False):
    """Settings of a session; the server chooses each key that is left out or None. Lengths are in the mesh's unit."""

    basis: Literal[
        "wendland-c0", "wendland-c2", "wendland-c2-multiscale", "wendland-c4", "wendland-c6", "ctps-c0", "ctps-c1",
        "ctps-c2a", "ctps-c2b", "tps", "mqb", "imqb", "iqb", "gauss",
    ]  # fmt: skip
    support_radius: float | None
    displacement: Literal["relative", "absolute", "reanchored"] | None
    sub_steps: Literal["auto", "never"]
    correction: Literal["none", "smooth", "imposed-gradient", "explicit", "enrichment", "optimised"] | None
    correction_target: Literal["threshold", "maximum"] | None
    quality_metric: Literal[
        "relative-size-skew", "size-skew", "size-skew-root", "size-skew-product", "size", "skew"
    ]  # fmt: skip
    quality_threshold: float
    refuse_below_threshold: bool
    allow_invalid: bool
    max_enrichment_points: int
    enrichment_radius: float | None
    reduction: Literal["none", "greedy", "grouped-circular"]

"""The choices of a session's motion, checked: the numerics' side of the case file's ``[method]``."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from mesh_motion_server.errors import InvalidInput

__all__ = ["CHOICES", "Method"]

#: The named choices and what may be chosen; ``basis`` is checked against the table of basis functions. The names stand
#: here and not only at what they choose: settings are read by processes that need neither scipy nor the compiler.
CHOICES: dict[str, tuple[str, ...]] = {
    "support_radius_choice": ("mesh", "motion"),
    "polynomial": ("auto", "none", "linear"),
    "displacement": ("relative", "absolute", "reanchored"),
    "correction": ("none", "imposed-gradient", "explicit", "enrichment", "optimised"),
    "correction_target": ("auto", "threshold", "maximum"),
    "enrichment_function": ("auto", "H1", "H2", "H3"),
    "enrichment_placement": ("auto", "spread", "minima", "boundary", "middle"),
    "explicit_decomposition": ("eigen", "polar", "svd", "qr"),
    "correction_in_time": ("independent", "smooth"),
    "sub_steps": ("auto", "never", "always"),
    "quality_metric": (
        "relative-size-skew",
        "size-skew",
        "size-skew-root",
        "size-skew-product",
        "size",
        "skew",
    ),
    "predictor": ("trial-nodes", "edge-midpoint-gradient", "centre-gradient", "sampled"),
    "quality_report": ("every-move", "first-and-commit"),
    "solver": ("auto", "dense", "sparse", "iterative", "two-scale"),
    "reduction": (
        "none",
        "greedy",
        "one-point",
        "greedy-combined",
        "error-peaks",
        "incremental-lu",
        "recurrence-cholesky",
        "grouped-circular",
        "multilevel-subspace",
        "multi-step",
        "multiscale",
        "grid-clustering",
    ),
    "volume_reduction": ("none", "enclosing-box", "wall-function", "background-grid"),
}


@dataclass(frozen=True, kw_only=True)
class Method:
    """How a mesh is moved; every field is a key of the case file's ``[method]``.

    Attributes
    ----------
    basis : str
        Name of the radial basis function (thesis Tables 2.1, 2.2).
    support_radius : float or None
        R, mesh length unit; None: chosen.
    support_radius_choice : {"mesh", "motion"}
        What a radius that is not given is chosen from: the mesh, when the session is built; or each motion, which is
        predicted with four radii and takes the best.
    polynomial : {"auto", "none", "linear"}
        The p of thesis (2.1); "auto": where the basis demands it.
    displacement : {"relative", "absolute", "reanchored"}
        Interpolate the displacement since the committed state, the total one from the reference mesh, or the total
        one from the reference mesh through sub-steps along a rotation-aware path.
    correction : {"none", "imposed-gradient", "explicit", "enrichment", "optimised"}
    correction_target : {"auto", "threshold", "maximum"}
        Where a correction stops once the prediction is below the threshold.
    correction_in_time : {"independent", "smooth"}
        Each motion is corrected on its own, as far as the threshold and the target ask, or the correction is a smooth
        function of the boundary, always active and without either. "smooth" needs the correction "optimised" and a
        displacement from the reference mesh.
    sub_steps : {"auto", "never", "always"}
        Lead the mesh to its targets in legs, each corrected (:mod:`.motion.sub_steps`): where the
        corrected motion would be refused, never, or always. A motion without correction is never cut.
    enrichment_radius : float or None
        R_l, mesh length unit; None: the diameter of the largest ball between the boundaries, at most R.
    quality_metric : str
        Against the cell at rest, or against an ideal one.
    quality_threshold : float
        A motion predicted below it is corrected.
    max_enrichment_points : int
    enrichment_function : {"auto", "H1", "H2", "H3"}
        Thesis (4.5)–(4.7); auto: H1, with correction "enrichment" H1 and H2 together.
    enrichment_placement : {"auto", "spread", "minima", "boundary", "middle"}
        Bad cells apart from each other, worst-quality minima (4.11), boundary nodes, the middle of a gap (1D); auto:
        "spread" for "enrichment"; "middle" in 1D and "minima" above for "imposed-gradient". The others place their own.
    explicit_decomposition : {"eigen", "polar", "svd", "qr"}
        What "explicit", and above 1D "imposed-gradient", correct a cell by.
    reduction : str
        Which boundary nodes the interpolation starts from: "none": all; otherwise one of
        :data:`~mesh_motion_server.numerics.reduction.REDUCTIONS`, corrected near the surface (thesis §2.2).
    reduction_tolerance : float
        Largest error that a reduction may leave at a boundary node before it is corrected, as a share of the largest
        displacement.
    max_control_points : int
        Most nodes a reduction may choose; 0: no bound.
    volume_reduction : {"none", "enclosing-box", "wall-function", "background-grid"}
        At which places the interpolation is evaluated (thesis §2.2.1).
    volume_reduction_length : float or None
        The box's margin around the body, the wall function's D or the grid's spacing, mesh length unit; None: chosen
        from the mesh and the motion.
    boundary_layer_thickness : float or None
        Nodes this near to a moving wall move with it, mesh length unit; None: all nodes are interpolated.
    refuse_below_threshold : bool
        Refuse a valid motion that stays below the threshold; otherwise it is kept with a warning.
    allow_invalid : bool
        Keep a motion that inverts cells instead of refusing it; for studies of the plain method.
    predictor : str
        How the quality of the standard motion is predicted; "sampled" is exact below the threshold and at the
        minimum, and by expansion elsewhere.
    quality_report : {"every-move", "first-and-commit"}
        Which motions are told with the distributions of the quality: all, or of the coupling iterations of a step the
        first, and what is committed; a later iteration then tells minimum, inverted and worst cells, as exact as ever.
    solver : str
        How the interpolation system is factorized.
    """

    basis: str = "wendland-c2"
    support_radius: float | None = None
    support_radius_choice: str = "mesh"
    polynomial: str = "auto"
    displacement: str = "relative"
    correction: str = "optimised"
    correction_target: str = "auto"
    correction_in_time: str = "independent"
    sub_steps: str = "auto"
    enrichment_radius: float | None = None
    quality_metric: str = "relative-size-skew"
    quality_threshold: float = 0.2
    max_enrichment_points: int = 20
    enrichment_function: str = "auto"
    enrichment_placement: str = "auto"
    explicit_decomposition: str = "eigen"
    reduction: str = "none"
    reduction_tolerance: float = 1e-3
    max_control_points: int = 0
    volume_reduction: str = "none"
    volume_reduction_length: float | None = None
    boundary_layer_thickness: float | None = None
    refuse_below_threshold: bool = False
    allow_invalid: bool = False
    predictor: str = "trial-nodes"
    quality_report: str = "first-and-commit"
    solver: str = "auto"

    def __post_init__(self) -> None:
        for name, known in CHOICES.items():
            if getattr(self, name) not in known:
                raise InvalidInput(f"{name}: {getattr(self, name)!r} is not known; known are {', '.join(known)}")
        for name in ("support_radius", "enrichment_radius", "volume_reduction_length", "boundary_layer_thickness"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise InvalidInput(f"{name} must be a positive length in the mesh's unit, got {value!r}")
        if not (math.isfinite(self.quality_threshold) and self.quality_threshold <= 1):
            raise InvalidInput(f"quality_threshold must be a number up to 1, got {self.quality_threshold!r}")
        for name in ("max_enrichment_points", "max_control_points"):
            if getattr(self, name) < 0:
                raise InvalidInput(f"{name} must be 0 or more, got {getattr(self, name)!r}")
        if not (math.isfinite(self.reduction_tolerance) and self.reduction_tolerance >= 0):
            raise InvalidInput(f"reduction_tolerance must be a number from 0 on, got {self.reduction_tolerance!r}")

    def as_dict(self) -> dict[str, object]:
        """The choices as plain values, in the order of the fields."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

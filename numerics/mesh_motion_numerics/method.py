"""The keys of the case file's ``[method]`` and of OPEN's settings, each declared once.

A field of :class:`Method` is a key. Its :class:`Key` has the range or choices, the meaning, when to change it, and the
values of other keys that it needs. The strict checks at the edges (:mod:`mesh_motion_server.settings`), the tables of
SPEC.md, docs/method.md and docs/reference/case_file.md are made from it. A new key is a field here, the code that reads
it, and the test of that code.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

from mesh_motion_protocol.errors import InvalidInput

T = TypeVar("T")
Needs = Mapping[str, Mapping[str, tuple[str, ...]]]


@dataclass(frozen=True, kw_only=True)
class Key:
    """The data of a key, apart from its name."""

    default: str | float | bool | None  # None: chosen by the server
    group: str  # heading of docs/method.md under which the key is described
    meaning: str  # meaning of the key, in one sentence
    when: str  # when to change it, Markdown; links are relative to ``docs/``
    #: Allowed values of a text. They are listed here because processes without scipy and the compiled loops check them.
    choices: tuple[str, ...] = ()
    remark: str = ""  # why an expected choice does not exist; shown in parentheses after the expected values
    #: above, low, high: range of a number: larger than ``above``; from ``low``; up to ``high``
    above: float | None = None
    low: float | None = None
    high: float | None = None
    #: Choice → other key → values that the other key may have with this choice.
    needs: Needs = field(default_factory=dict)

    @property
    def kind(self) -> type:
        """str, bool, int or float; a key without a default and choices is a float."""
        return str if self.choices else float if self.default is None else type(self.default)

    @property
    def expected(self) -> str:
        """Description of the expected value, in words."""
        if self.choices:
            return f"one of {', '.join(self.choices)}{self.remark and f' ({self.remark})'}"
        name = {bool: "true or false", int: "an integer", float: "a number"}[self.kind]
        bounds = {"greater than": self.above, "from": self.low, "to": self.high}
        return " ".join([name, *(f"{word} {bound:.15g}" for word, bound in bounds.items() if bound is not None)])

    def admits(self, value: object) -> bool:
        """Whether a value is of the type and in the range."""
        if value is None or self.choices:
            return value in self.choices or (value is None and self.default is None)
        if self.kind is bool or isinstance(value, bool):
            return isinstance(value, bool) and self.kind is bool
        if not isinstance(value, int if self.kind is int else int | float) or not math.isfinite(value):
            return False
        above, low, high = self.above, self.low, self.high
        return (above is None or value > above) and (low is None or value >= low) and (high is None or value <= high)


def _key(default: T, group: str, meaning: str, when: str, **more: Any) -> T:
    """A field of :class:`Method` with its :class:`Key`."""
    key = Key(default=default, group=group, meaning=meaning, when=when, **more)  # type: ignore[arg-type]  # checked by T
    return field(default=default, metadata={"key": key})


_INTERPOLATION, _DISPLACEMENT, _CORRECTION, _REDUCTION = "Interpolation", "Displacement", "Correction", "Fewer points"

_COMPACT = (
    "wendland-c0", "wendland-c2", "wendland-c2-multiscale", "wendland-c4", "wendland-c6", "ctps-c0", "ctps-c1",
    "ctps-c2a", "ctps-c2b",
)  # fmt: skip
_DEFINITE = ("imqb", "iqb", "gauss")
_CORRECTIONS = ("imposed-gradient", "explicit", "enrichment", "optimised")
_REDUCTIONS = ("greedy", "grouped-circular")


@dataclass(frozen=True, kw_only=True)
class Method:
    """How a mesh is moved. Lengths are in the mesh's unit."""

    basis: str = _key(
        "wendland-c2",
        _INTERPOLATION,
        "The radial basis function (thesis Tables 2.1, 2.2); `tps` and `mqb` get the linear polynomial that they need. "
        "`wendland-c2-multiscale` is 64/85 Σ φ(2ᵏr/R)/4ᵏ, k = 0 … 3, of φ = `wendland-c2`.",
        "`wendland-c2` is compact, positive definite and smooth. `tps` is the widest: it keeps most quality without a "
        "correction and moves a far field that is not held with the boundary, at the cost of a full matrix "
        "([measured](thesis.md#basis-functions-and-the-polynomial-term)).",
        choices=(*_COMPACT, "tps", "mqb", *_DEFINITE),
        remark="not qb: its interpolation matrix is singular",
    )
    support_radius: float | None = _key(
        None,
        _INTERPOLATION,
        "R. Default: 2.5 times the longest side of the domain; if the domain is longer than 20 times the moving "
        "bodies, 50 times the longest side of the bodies. With the corrections `none` and `smooth`: in a domain "
        "longer than 3.5 such sides, 10 of them with `wendland-c2-multiscale` in place of `wendland-c2`; and if all "
        "fixed nodes are 5 sides away, the bodies' mean displacement is carried further than the rest.",
        "Make it smaller for bodies in narrow channels with correction `none` or `explicit`: near the width of the "
        "gap. Optimised corrections depend little on R ([measured](beyond.md#defaults)).",
        above=0.0,
    )
    displacement: str = _key(  # type: ignore[assignment]  # chosen in __post_init__
        None,
        _DISPLACEMENT,
        "What is interpolated: the displacement since the committed state, the total one from the reference mesh, or "
        "the total one in sub-steps along a path that turns with the body. Default: "
        '`"absolute"` with the correction `"smooth"`, otherwise `"relative"`.',
        '`"relative"` takes large total motions in small steps, but drifts when the motion comes back; `"absolute"` '
        'and `"reanchored"` depend on where the boundary is, not on how it got there '
        '([drift study](thesis.md#relative-absolute-and-re-anchored-displacement)). With `"absolute"` one '
        "factorization serves the whole run.",
        choices=("relative", "absolute", "reanchored"),
    )
    sub_steps: str = _key(
        "auto",
        _DISPLACEMENT,
        "Move the mesh to its target in several corrected sub-steps, each body along a path that turns with it: "
        '`"auto"` only if one step would be refused, `"never"` not at all.',
        'Set `"never"` to get the refusal at once '
        "([what sub-steps reach](beyond.md#valid-wherever-a-valid-mesh-exists)).",
        choices=("auto", "never"),
    )
    correction: str = _key(  # type: ignore[assignment]  # chosen in __post_init__
        None,
        _CORRECTION,
        'How the mesh is corrected to keep its quality. `"smooth"`: the mesh is a smooth function of where the '
        "boundary is; the correction begins when a cell has lost a tenth of its shape or size at rest, has no "
        "threshold and no target, and layers of thin cells, and first cells at plane bodies, always move with their "
        "wall. The others correct a motion that is predicted below the threshold; layers move with their wall if they "
        "would lose their quality. "
        'Default: `"smooth"`, unless a key needs a feature that only `"optimised"` has (a displacement `"relative"`, '
        'another metric, a target, a reduction). A motion for which `"smooth"` finds no mesh is corrected as '
        '`"optimised"` does, with a warning.',
        '`"smooth"` suits coupled runs: node velocities without jumps (geometric conservation), the same mesh for the '
        'same boundary after any number of steps. `"optimised"` frees trial nodes as needed and reaches most in one '
        'step; `"enrichment"` optimises the coefficients of few '
        'enrichment functions ([when which](beyond.md#when-enrichment-when-freed-nodes-when-sub-steps)); `"explicit"` '
        'and `"imposed-gradient"` are the thesis\' methods; `"none"` leaves the interpolation alone.',
        choices=("none", "smooth", *_CORRECTIONS),
        needs={"smooth": {"displacement": ("absolute", "reanchored")}},
    )
    correction_target: str | None = _key(
        None,
        _CORRECTION,
        "Where a correction stops: when every cell is at the threshold, or at the best it can reach. Default: the "
        "best, if it takes at most a second or two (up to 30 000 free nodes in 2D, 5 000 in 3D), else the threshold.",
        '`"threshold"`: its cost follows the bad region. `"maximum"` goes on, and is within a hundredth of the best '
        "known on average, [in 2D and in 3D](beyond.md#the-ceiling-and-its-cost).",
        choices=("threshold", "maximum"),
    )
    quality_metric: str = _key(
        "relative-size-skew",
        _CORRECTION,
        "The quality of a cell.",
        '`"relative-size-skew"` compares each cell with itself at rest: √size · shape relative to rest '
        "([why](beyond.md#judged-against-the-cell-at-rest)). The others compare the skew with an ideal cell: "
        '`"size-skew"` is √size · skew; `"size-skew-root"` is √(size · skew), `"size-skew-product"` size · skew; '
        '`"size"` and `"skew"` are its parts.',
        choices=("relative-size-skew", "size-skew", "size-skew-root", "size-skew-product", "size", "skew"),
    )
    quality_threshold: float = _key(
        0.2,
        _CORRECTION,
        "A motion predicted below it is corrected.",
        "Set it to the quality that your solver needs ([choosing it](choosing.md)).",
        low=-1.0,
        high=1.0,
    )
    refuse_below_threshold: bool = _key(
        False,
        _CORRECTION,
        "Refuse a valid motion that stays below the threshold; otherwise it is kept with a warning.",
        "Use it if the driver can repeat a refused step with a smaller one.",
    )
    allow_invalid: bool = _key(
        False,
        _CORRECTION,
        "Keep a motion that inverts cells instead of refusing it.",
        'For studies of the plain method, with correction `"none"`.',
    )
    max_enrichment_points: int = _key(
        20,
        _CORRECTION,
        "Largest number of enrichment points; freed nodes have no such limit.",
        "Use more if several places are bad at once and the correction is not `optimised`.",
        low=0,
        high=100_000,
    )
    enrichment_radius: float | None = _key(
        None,
        _CORRECTION,
        "R_l of the enrichment. Default: the diameter of the largest ball between the boundaries, at most R.",
        "Set it to reproduce a published setting ([measured](beyond.md#defaults)).",
        above=0.0,
    )
    reduction: str = _key(
        "none",
        _REDUCTION,
        "Boundary nodes that the interpolation uses: all, or a selection that leaves an error of at most a thousandth "
        "of the largest displacement at the others; a near-surface correction makes these exact (thesis §2.2).",
        'For tens of thousands of boundary nodes: `"greedy"` adds the node with the largest error; '
        '`"grouped-circular"` searches this node in one group of nodes after the other, is up to ten times as fast and '
        "takes some more nodes ([others compared](thesis.md#point-reduction-groups-levels-and-grids)).",
        choices=("none", *_REDUCTIONS),
        needs={name: {"basis": (*_COMPACT, *_DEFINITE)} for name in _REDUCTIONS},
    )

    def __post_init__(self) -> None:
        self._choose_what_is_left_out()
        for name, key in KEYS.items():
            value = getattr(self, name)
            if not key.admits(value):
                raise _refused(name, f"{name}: expected {key.expected}, got {value!r}", "set another value")
            for other, allowed in key.needs.get(str(value), {}).items():
                if getattr(self, other) not in allowed:
                    expected, got = " or ".join(map(repr, allowed)), getattr(self, other)
                    message = f"{name} = {value!r}: expected {other} {expected}, got {got!r}"
                    raise _refused(name, message, f"set another {other}, or leave {name} out")

    def _choose_what_is_left_out(self) -> None:
        """Choose the kind of motion: a smooth one, unless a key is given that only the other kind has."""
        others = ("quality_metric", "correction_target", "reduction")
        asked = self.displacement == "relative" or any(getattr(self, name) != KEYS[name].default for name in others)
        if self.correction is None:
            object.__setattr__(self, "correction", "optimised" if asked else "smooth")
        if self.displacement is None:
            object.__setattr__(self, "displacement", "absolute" if self.correction == "smooth" else "relative")

    def as_dict(self) -> dict[str, object]:
        """The choices as plain values, in the order of the fields."""
        return {name: getattr(self, name) for name in KEYS}


def _refused(setting: str, message: str, hint: str) -> InvalidInput:
    return InvalidInput(message, code="INVALID_ARGUMENT.SETTINGS", hint=hint, details={"setting": setting})


KEYS: dict[str, Key] = {each.name: each.metadata["key"] for each in fields(Method)}
"""Every key by its name."""

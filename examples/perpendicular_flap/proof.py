"""The perpendicular flap against its published reference: ``make flap``.

Runs the benchmark with the mesh-motion server and with OpenFOAM's displacementLaplacian, and a softer flap with both;
prints period, amplitude and the end of each run, draws the tip's histories to tip.png, and ends with status 1 if a
tolerance is exceeded. Stopped runs are continued.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import flap
import numpy as np
from mesh_motion_calculix import CalculixError
from mesh_motion_fsi import FsiError, Row, read_history
from numpy.typing import NDArray
from scipy.optimize import least_squares

Array = NDArray[np.float64]
#: The tip in the preCICE tutorials' reference results (perpendicular-flap/reference-results/nutils-dealii.log): maxima
#: of 0.1956 m at 0.74 s, 0.1829 m at 2.37 s and 0.1710 m at 3.99 s, the first minimum of -0.0021 m at 1.48 s.
PERIOD, AMPLITUDE = 1.625, 0.0989
PERIOD_TOLERANCE, AMPLITUDE_TOLERANCE = 0.05, 0.10
MOTIONS = {"server": "mesh-motion server", "laplacian": "displacementLaplacian"}


@dataclass(frozen=True)
class Case:
    """A run of the proof."""

    name: str
    motion: str
    young: float
    windows: int
    #: Of the momentum equation: on strongly skewed meshes the outer correctors diverge without it.
    relaxation: float = 1.0


@dataclass(frozen=True)
class Outcome:
    """How a run ended."""

    case: Case
    rows: list[Row]
    error: str
    seconds: float

    @property
    def history(self) -> tuple[Array, Array]:
        """Times, s, and the tip's displacements in x, m: (n,) arrays."""
        return np.array([row.time for row in self.rows]), np.array([row.x for row in self.rows])


def period(t: Array, x: Array) -> float:
    """The period of x(t) = c + e^(-g t) (a cos(2π t / T) + b sin(2π t / T)) that fits best."""

    def residual(p: Array) -> Array:
        return np.asarray(p[0] + np.exp(-p[3] * t) * (p[1] * np.cos(p[4] * t) + p[2] * np.sin(p[4] * t)) - x)

    middle, half = (x.max() + x.min()) / 2.0, (x.max() - x.min()) / 2.0
    fit = least_squares(residual, [middle, -half, 0.0, 0.0, 2.0 * np.pi / PERIOD])
    return float(2.0 * np.pi / fit.x[4])


def amplitude(t: Array, x: Array) -> float:
    """Half of the first swing: from the first period's maximum to the next minimum."""
    top = int(np.argmax(np.where(t < PERIOD, x, -np.inf)))
    return float(x[top] - x[top:][t[top:] < t[top] + PERIOD].min()) / 2.0


def play(case: Case, out: Path) -> Outcome:
    """Run a case; an error is an outcome."""
    sys.stdout.write(f"\n{case.name}, {MOTIONS[case.motion]}\n")
    given = ["--out", str(out / f"{case.name}-{case.motion}"), "--motion", case.motion]
    given += ["--young", repr(case.young), "--windows", str(case.windows), "--relaxation", repr(case.relaxation)]
    options = flap.arguments(given)
    began, error = time.monotonic(), ""
    try:
        flap.run(options)
    except (FsiError, CalculixError) as failure:
        error = str(failure)
        sys.stdout.write(f"{error}\n")
    return Outcome(case, read_history(options.out), error, time.monotonic() - began)


def judge(outcome: Outcome) -> tuple[list[str], bool]:
    """Lines on the benchmark's period and amplitude, and whether both are within the tolerances."""
    t, x = outcome.history
    lines, good = [], not outcome.error
    for name, value, reference, tolerance, unit in (
        ("period", period(t, x) if len(t) > 4 else np.nan, PERIOD, PERIOD_TOLERANCE, "s"),
        ("amplitude", amplitude(t, x) if len(t) else np.nan, AMPLITUDE, AMPLITUDE_TOLERANCE, "m"),
    ):
        off = value / reference - 1.0
        passed = abs(off) <= tolerance
        good = good and passed
        lines.append(
            f"  {name:9} {value:.4f} {unit}  reference {reference} {unit}, {100 * off:+.1f} %"
            f" (±{100 * tolerance:g} %)  {'PASS' if passed else 'FAIL'}"
        )
    return lines, good


def line(outcome: Outcome) -> str:
    """Last time of a run and its cost."""
    done = len(outcome.rows)
    end = "finished" if not outcome.error else f"ended in window {done + 1}: {outcome.error[:200]}"
    cost = sum(row.seconds for row in outcome.rows)
    iterations = sum(row.iterations for row in outcome.rows) / max(done, 1)
    most = max((row.x for row in outcome.rows), default=0.0)
    return (
        f"{outcome.case.name}, {MOTIONS[outcome.case.motion]}: {done} of {outcome.case.windows} windows, {cost:.0f} s, "
        f"{iterations:.1f} iterations a window, tip at most {most:.3f} m; {end}"
    )


def draw(outcomes: list[Outcome], path: Path) -> None:
    """The tip's histories."""
    import matplotlib  # noqa: PLC0415  not needed without a picture

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415

    names = list(dict.fromkeys(outcome.case.name for outcome in outcomes))
    figure, panels = plt.subplots(len(names), 1, figsize=(8, 3.5 * len(names)), squeeze=False, layout="constrained")
    for name, axes in zip(names, panels[:, 0], strict=True):
        for outcome in (outcome for outcome in outcomes if outcome.case.name == name):
            t, x = outcome.history
            style = "-" if outcome.case.motion == "server" else "--"
            axes.plot(t, x, style, label=MOTIONS[outcome.case.motion])
            if outcome.error and len(t):
                axes.plot(t[-1], x[-1], "kx", label=f"{MOTIONS[outcome.case.motion]} ends")
        if name == "flap":
            tops, bottom = ([0.74, 2.37, 3.99], [0.1956, 0.1829, 0.1710]), ([1.48], [-0.0021])
            axes.plot(
                *(a + b for a, b in zip(tops, bottom, strict=True)), "o", mfc="none", label="reference's extremes"
            )
        axes.set(title=name, xlabel="time [s]", ylabel="tip displacement in x [m]")
        axes.legend()
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> int:
    """All runs, the table, the picture."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/flap"))
    parser.add_argument("--only", help="run only cases whose name and motion begin with this, for example flap-server")
    options = parser.parse_args()
    out: Path = options.out
    cases = [case for case in CASES if f"{case.name}-{case.motion}".startswith(options.only or "")]
    outcomes = [play(case, out) for case in cases]
    good = True
    sys.stdout.write("\n")
    figures = []
    for outcome in outcomes:
        lines, passed = judge(outcome) if outcome.case.name == "flap" else ([], not outcome.error)
        sys.stdout.write("\n".join([line(outcome), *lines]) + "\n")
        figures.append({"run": line(outcome), "results": [entry.strip() for entry in lines], "passed": passed})
        if outcome.case.motion == "server":  # the control may end as it likes
            good = good and passed
    (out / "proof.json").write_text(json.dumps(figures, indent=1) + "\n")
    draw(outcomes, out / "tip.png")
    sys.stdout.write(f"{'PASS' if good else 'FAIL'}  {out / 'tip.png'}\n")
    return int(not good)


CASES = (
    Case("flap", "server", 4e6, 500),
    Case("flap", "laplacian", 4e6, 500),
    Case("softer", "server", 4e5, 200, relaxation=0.95),
    Case("softer", "laplacian", 4e5, 200, relaxation=0.95),
)

if __name__ == "__main__":
    sys.exit(main())

"""Turek and Hron's FSI2 and FSI3 against their published figures: ``make turek CASE=fsi3``.

Runs the case on three meshes with the mesh-motion server and on the middle one with OpenFOAM's displacementLaplacian,
or in Kratos with the server and with Kratos' structural_similarity (``make turek CASE=fsi2 SOLVER=kratos``);
prints mean, amplitude and frequency of A's displacement, drag and lift over the last periods, draws the histories, and
ends with status 1 where the finest mesh misses a tolerance. Stopped runs are continued; ``--read`` only evaluates the
histories in ``results/``.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import turek
from channel import DEPTH
from mesh_motion_calculix import CalculixError
from mesh_motion_fsi import FsiError, read_history
from numpy.typing import NDArray

Array = NDArray[np.float64]
HERE = Path(__file__).resolve().parent
NAMES = ("ux", "uy", "drag", "lift")
UNITS = {"ux": "mm", "uy": "mm", "drag": "N/m", "lift": "N/m"}
#: Mean, amplitude and frequency (Hz) of each: S. Turek, J. Hron (2006), the tables' finest rows.
PUBLISHED = {
    "fsi2": {
        "ux": (-14.58, 12.44, 3.8),
        "uy": (1.23, 80.6, 2.0),
        "drag": (208.83, 73.75, 3.8),
        "lift": (0.88, 234.2, 2.0),
    },
    "fsi3": {
        "ux": (-2.69, 2.53, 10.9),
        "uy": (1.48, 34.38, 5.3),
        "drag": (457.3, 22.66, 10.9),
        "lift": (2.22, 149.78, 5.3),
    },
}
AMPLITUDE_TOLERANCE, FREQUENCY_TOLERANCE = 0.05, 0.02  # of uy
PERIODS = 6  # of uy, that are looked at
#: By solver: names and options of its runs; what is named a control does not decide.
RUNS = {
    "openfoam": {
        "coarse": ("--refinement", "0.7"),
        "middle": ("--refinement", "1.0"),
        "fine": ("--refinement", "1.3"),
        "control": ("--refinement", "1.0", "--motion", "laplacian"),
    },
    "kratos": {
        "kratos-coarse": ("--elements", "22", "--coarsest", "0.05"),
        "kratos": ("--motion", "server"),
        "kratos-control": ("--motion", "own"),
    },
}
LABELS = {
    "coarse": "server, 6 300 cells",
    "middle": "server, 13 000 cells",
    "fine": "server, 22 000 cells",
    "control": "displacementLaplacian, 13 000 cells",
    "kratos-coarse": "Kratos and server, 3 400 nodes",
    "kratos": "Kratos and server, 6 900 nodes",
    "kratos-control": "Kratos alone, 6 900 nodes",
}


@dataclass(frozen=True)
class Figure:
    """One quantity in its last periods: middle and half of its range (means over the periods), frequency, Hz."""

    mean: float
    amplitude: float
    frequency: float


def figures(t: Array, values: Array, period: float) -> Figure:
    """The figures of a history (n,) over the last ``PERIODS`` periods of given length, s."""
    last = [(t > t[-1] - (k + 1) * period) & (t <= t[-1] - k * period) for k in range(PERIODS)]
    tops, bottoms = ([extreme(values[rows]) for rows in last] for extreme in (np.max, np.min))
    middle = float(np.mean(tops) + np.mean(bottoms)) / 2.0
    return Figure(
        middle, float(np.mean(tops) - np.mean(bottoms)) / 2.0, frequency(t, values - middle, PERIODS * period)
    )


def frequency(t: Array, values: Array, span: float) -> float:
    """Frequency from the first to the last rise through a third of the amplitude, within ``span`` s; nan without rises.

    Two rises count only with a fall through minus a third between them, because noise of the residual is not a period.
    """
    late = t > t[-1] - span
    t, values = t[late], values[late]
    level, below, rises = float(np.ptp(values)) / 6.0, False, []
    for i in range(1, len(values)):
        below = below or bool(values[i] < -level)
        if below and values[i] >= level:
            rises.append(t[i] - (values[i] - level) * (t[i] - t[i - 1]) / (values[i] - values[i - 1]))
            below = False
    return (len(rises) - 1) / float(rises[-1] - rises[0]) if len(rises) > 1 else float("nan")


def read_run(folder: Path) -> dict[str, Array]:
    """Time and the four quantities (n,) of a run's windows, in the units of ``UNITS``."""
    rows = read_history(folder)
    forces: dict[int, list[float]] = {}
    written = (folder / "fluid" / "postProcessing" / "forces").glob("*/force.dat")
    parts = sorted(written, key=lambda path: float(path.parent.name))
    dt = rows[0].time / rows[0].window if rows else 1.0
    for part in parts:  # a later run has the last word on a window that was computed again
        for line in part.read_text().splitlines():
            if not line.startswith("#"):
                time, x, y = (float(word) for word in line.replace("(", " ").replace(")", " ").split()[:3])
                forces[round(time / dt)] = [x / DEPTH, y / DEPTH]
    rows = [row for row in rows if row.window in forces]
    table = np.array([[row.time, 1e3 * row.x, 1e3 * row.y, *forces[row.window]] for row in rows]).reshape(-1, 5)
    return dict(zip(("t", *NAMES), table.T, strict=True))


def judge(case: str, runs: dict[str, dict[str, Array]]) -> tuple[list[str], bool]:
    """The table's lines, and True if uy on the finest computed mesh is within the tolerances."""
    published = PUBLISHED[case]
    period = 1.0 / published["uy"][2]
    found = {
        name: {quantity: figures(run["t"], run[quantity], period) for quantity in NAMES}
        for name, run in runs.items()
        if len(run["t"]) and run["t"][-1] > (PERIODS + 1) * period
    }
    lines = [f"| {case.upper()} | published | " + " | ".join(LABELS[name] for name in found) + " |"]
    lines.append("|---" * (len(found) + 2) + "|")
    for quantity in NAMES:
        mean, amplitude, hertz = published[quantity]
        row = f"| {quantity} [{UNITS[quantity]}] | {mean:.2f} ± {amplitude:.2f} [{hertz:.1f} Hz] |"
        lines.append(row + "".join(f" {cell(figure[quantity])} |" for figure in found.values()))
    good = False
    for name, figure in found.items():
        amplitude_off = figure["uy"].amplitude / published["uy"][1] - 1.0
        # ux and drag have twice the frequency of uy: the rounded published values of both give bounds for it
        low, high = sorted((published["uy"][2], published["ux"][2] / 2.0))
        hertz = figure["uy"].frequency
        frequency_off = hertz / min(max(hertz, low), high) - 1.0
        passed = abs(amplitude_off) <= AMPLITUDE_TOLERANCE and abs(frequency_off) <= FREQUENCY_TOLERANCE
        good = passed if "control" not in name else good
        lines.append(
            f"{LABELS[name]}: amplitude of uy {100 * amplitude_off:+.1f} %, "
            f"frequency {100 * frequency_off:+.1f} % from {low:g} to {high:g} Hz"
            f"  {'PASS' if passed else 'FAIL'}"
        )
    return lines, good


def cell(figure: Figure) -> str:
    """A figure as text for the table."""
    return f"{figure.mean:.2f} ± {figure.amplitude:.2f} [{figure.frequency:.2f} Hz]"


def draw(case: str, runs: dict[str, dict[str, Array]], path: Path) -> None:
    """Histories of the four quantities: whole runs on the left, their last periods on the right."""
    import matplotlib  # noqa: PLC0415  not needed without a picture

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415

    published = PUBLISHED[case]
    figure, panels = plt.subplots(4, 2, figsize=(12, 10), width_ratios=(2, 1), layout="constrained", sharex="col")
    for quantity, (whole, late) in zip(NAMES, panels, strict=True):
        mean, amplitude, _ = published[quantity]
        for axes in (whole, late):
            for name, run in runs.items():
                times = run["t"] - run["t"][-1:] if axes is late else run["t"]  # no two runs end at the same time
                axes.plot(times, run[quantity], "--" if "control" in name else "-", lw=0.9, label=LABELS[name])
            axes.axhspan(mean - amplitude, mean + amplitude, color="0.9", zorder=0, label="published range")
            axes.grid(alpha=0.3)
        whole.set_ylabel(f"{quantity} [{UNITS[quantity]}]")
        if quantity == "drag":  # without its way up from zero
            for axes in (whole, late):
                axes.set_ylim(mean - 3.0 * amplitude, mean + 2.0 * amplitude)
    panels[3, 1].set_xlim(-4.0 / published["uy"][2], 0.0)
    panels[3, 1].locator_params(axis="x", nbins=5)
    for axes, label in zip(panels[3], ("time [s]", "time before a run's end [s]"), strict=True):
        axes.set_xlabel(label)
    panels[0, 0].legend(loc="upper left", fontsize="small")
    panels[0, 0].set_title(f"{case.upper()}: displacement of A, drag and lift")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def play(case: str, solver: str, name: str, out: Path) -> dict[str, Array]:
    """Start or continue a run; an error is an outcome, printed in a line."""
    folder = out / f"{case}-{name}"
    sys.stdout.write(f"\n{case.upper()}, {LABELS[name]}\n")
    given = ["--out", str(folder), *RUNS[solver][name]]
    try:
        if solver == "kratos":
            return play_in_kratos([case, *given])
        turek.run(turek.arguments([case, *given]))
    except (FsiError, CalculixError) as error:
        sys.stdout.write(f"{error}\n")
    return read_run(folder)


def play_in_kratos(given: list[str]) -> dict[str, Array]:
    """The run in Kratos, in the form of :func:`read_run`."""
    import kratos  # noqa: PLC0415  needs adapters/kratos in PYTHONPATH

    options = kratos.arguments(given)
    try:
        kratos.run(options)
    except kratos.RunFailed as error:
        sys.stdout.write(f"{error}\n")
        if not (options.out / "history.npz").exists():
            raise SystemExit(1) from None
    with np.load(options.out / "history.npz") as run:
        columns = (run["times"], *(1e3 * run["displacements"][:, 0].T), *run["forces"].T)
    return dict(zip(("t", *NAMES), columns, strict=True))


def main() -> int:
    """The runs, the table, the picture."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("case", choices=sorted(PUBLISHED))
    parser.add_argument("--out", type=Path, default=Path("out/turek"))
    parser.add_argument("--solver", choices=sorted(RUNS), default="openfoam", help="solver of the runs")
    parser.add_argument("--only", choices=sorted(LABELS), help="run only this one")
    parser.add_argument("--read", action="store_true", help="judge the stored histories without a run")
    options = parser.parse_args()
    kept = HERE / "results" if options.read else options.out
    kept.mkdir(parents=True, exist_ok=True)
    runs = {}
    for name in RUNS[options.solver]:
        path = kept / f"{options.case}-{name}.npz"
        if options.only in (None, name) and not options.read:
            run = play(options.case, options.solver, name, options.out)
            np.savez_compressed(path, **{key: run[key].astype(np.float32) for key in run})
        if path.exists():
            with np.load(path) as record:
                runs[name] = {key: record[key].astype(np.float64) for key in record.files}
    lines, good = judge(options.case, runs)
    sys.stdout.write("\n" + "\n".join(lines) + "\n")
    picture = kept / f"{options.case}{'-kratos' if options.solver == 'kratos' else ''}.png"
    draw(options.case, runs, picture)
    sys.stdout.write(f"{'PASS' if good else 'FAIL'}  {picture}\n")
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())

"""Figs 5.7 and 5.8: decompositions of B for some cells, and the result of each correction."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from docs.studies.study import Cell, Outcome, Picture, Study, Table
from docs.studies.thesis._cell_corrections import CELL_CORRECTIONS
from docs.studies.thesis._decompositions import eigen, polar, qr, rotation_angle, svd

Floats = NDArray[np.float64]


def turn(degrees: float) -> Floats:
    """Rotation matrix (2, 2)."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s], [s, c]])


#: Deformations of a square: those of Fig 5.7, inverted ones, and Fig 5.8's, which is valid by its determinant.
DEFORMATIONS = {
    "stretched": np.diag([1.6, 0.5]),
    "turned by 60°": turn(60.0),
    "sheared": np.array([[1.0, 1.2], [0.0, 1.0]]),
    "turned and stretched": turn(60.0) @ np.diag([1.5, 0.4]),
    "one direction reversed": np.diag([1.2, -0.4]),
    "turned, one reversed": turn(60.0) @ np.diag([1.2, -0.4]),
    "both reversed (Fig 5.8)": np.diag([-0.5, -0.8]),
    "turned by 150°, squeezed": turn(150.0) @ np.diag([0.9, 0.3]),
    "collapsed": np.array([[1.0, 0.5], [0.0, 0.0]]),
}


def run(quick: bool) -> Outcome:
    said: list[list[Cell]] = []
    mended: list[list[Cell]] = []
    for name, B in DEFORMATIONS.items():
        values = eigen(B[None]).values[0]
        turned, stretches, split = polar(B[None]).rotation, svd(B[None]).stretches[0], qr(B[None])
        said.append(
            [
                name,
                float(np.linalg.det(B)),
                ", ".join(_complex(value) for value in values),
                _angle(turned),
                _row(stretches),
                _angle(split.rotation),
                _row(np.diagonal(split.triangle[0])),
                _row(split.triangle[0, :1, 1]),
            ]
        )
        mended.append([name, *(_row(svd((B + _change(kind, B))[None]).stretches[0]) for kind in CELL_CORRECTIONS)])
    columns = ["cell", "det B", "eigenvalues (5.13)", "polar: turned by (5.10)", "principal stretches (5.8)"]
    columns += ["QR: turned by (5.9)", "its stretches", "its shear"]
    caption = "Principal stretches after one correction: a negative one is an inverted cell."
    tables = (Table(columns, said, digits=3), Table(("cell", *CELL_CORRECTIONS), mended, caption))
    angles = _angles(quick)
    pictures = (
        Picture(_cells, "The cells (grey: before), and what eigen and polar corrections make of them.", (9.5, 4.6)),
        Picture(lambda figure: _turning(figure, angles), _TURNING, (9.5, 3.2)),
    )
    return Outcome(tables, pictures, _text(angles))


_TURNING = (
    "A cell squeezed to a third and turned, corrected ten times: size after, gain of the smallest stretch in the first "
    "correction, and size of the first change."
)


def _change(kind: str, B: Floats) -> Floats:
    return CELL_CORRECTIONS[kind](B - np.eye(len(B)))


def _angles(quick: bool) -> dict[str, Floats]:
    """For each decomposition (angles, 3): size after ten corrections, first increase of the smallest stretch, |dJ|."""
    found = {}
    for kind in CELL_CORRECTIONS:
        rows = []
        for angle in _degrees(quick):
            B = turn(float(angle)) @ np.diag([1.2, 0.3])
            first = _change(kind, B)
            gain = svd((B + first)[None]).stretches[0, -1] - 0.3
            size = float(np.linalg.norm(first))
            for _ in range(10):
                B = B + _change(kind, B)
            tau = abs(float(np.linalg.det(B)))
            rows.append([np.sign(np.linalg.det(B)) * min(tau, 1 / tau), gain, size])
        found[kind] = np.array(rows)
    return found


def _degrees(quick: bool) -> Floats:
    return np.linspace(0.0, 180.0, 19 if quick else 181)


def _text(angles: dict[str, Floats]) -> str:
    eigenvalues, stretches = angles["eigen"], angles["polar"]
    return (
        "A cell squeezed to 0.3 and turned by any angle up to 180°: the polar correction raises its smallest stretch "
        "by 0.1 at every angle; the eigenvalue correction raises it by between {eigenvalues[:, 1].min():.2f} and "
        f"{eigenvalues[:, 1].max():.2f}, and its change of the Jacobian is up to "
        f"{eigenvalues[:, 2].max() / stretches[:, 2].max():.0f} times as large."
    )


def _complex(value: complex) -> str:
    real = f"{value.real:.2f}".replace("-", "−")
    return real if value.imag == 0 else f"{real} {'+' if value.imag > 0 else '−'} {abs(value.imag):.2f}i"


def _row(values: Floats) -> str:
    return ", ".join(f"{round(float(value), 2) + 0.0:.2f}" for value in values).replace("-", "−")


def _angle(rotation: Floats) -> str:
    return f"{round(float(np.degrees(rotation_angle(rotation)[0]))) + 0}°".replace("-", "−")


def _cells(figure: Any) -> None:
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) - 0.5
    axes = figure.subplots(2, 5).ravel()
    for ax, (name, B) in zip(axes, DEFORMATIONS.items(), strict=False):
        ax.fill(*square.T, color="0.9")
        ax.plot(*(square @ B.T).T, "k-", lw=1.5, label="deformed")
        for kind, colour in (("eigen", "C0"), ("polar", "C1")):
            mended = square @ (B + _change(kind, B)).T
            ax.plot(*mended.T, colour, lw=1.2, ls="--" if kind == "polar" else "-", label=kind)
        ax.plot(*(square[1] @ B.T), "ko", ms=3)
        ax.set_title(name, fontsize=8)
    for ax in axes:
        ax.set_aspect("equal")
        ax.set_axis_off()
        ax.set(xlim=(-1.2, 1.2), ylim=(-1.0, 1.0))
    axes[-1].legend(*axes[0].get_legend_handles_labels(), loc="center")


def _turning(figure: Any, angles: dict[str, Floats]) -> None:
    for column, (ax, title) in enumerate(
        zip(figure.subplots(1, 3), ("size after ten corrections", "first gain", "first |dJ|"), strict=True)
    ):
        for kind, rows in angles.items():
            # polar and qr nearly coincide: one is drawn dashed and wider below the other
            wide = kind == "polar"
            ax.plot(
                np.linspace(0, 180, len(rows)),
                rows[:, column],
                label=kind,
                lw=3.5 if wide else 1.2,
                alpha=0.5 if wide else 1,
            )
        ax.set(title=title, xlabel="turned by, degrees")
        ax.set_xticks([0, 45, 90, 135, 180])
    ax.set_yscale("log")
    ax.legend(fontsize=7)


def claims(outcome: Outcome) -> None:
    said, mended = outcome.tables
    rows = {row[0]: row for row in said.rows}
    assert float(rows["both reversed (Fig 5.8)"][1]) > 0
    assert rows["both reversed (Fig 5.8)"][2] == "−0.80, −0.50"
    assert rows["turned and stretched"][3] == rows["turned, one reversed"][3] == "60°"
    for name in ("one direction reversed", "turned, one reversed"):
        after = next(row for row in mended.rows if row[0] == name)
        assert "−" in str(rows[name][4])
        assert all("−" not in str(cell) for cell in after[1:])
    assert "by 0.1 at every angle" in outcome.text


STUDY = Study(
    "What does each decomposition of B = I + J say about a cell, and what does its correction do?",
    "Figs 5.7, 5.8 (equations 5.7–5.14, Algorithm 1)",
    run,
    claims,
    (
        "mesh_motion_numerics.decomposition.eigen",
        "docs.studies.thesis._decompositions.polar",
        "mesh_motion_numerics.decomposition.svd",
        "docs.studies.thesis._decompositions.qr",
        "docs.studies.thesis._cell_corrections.CELL_CORRECTIONS",
    ),
)

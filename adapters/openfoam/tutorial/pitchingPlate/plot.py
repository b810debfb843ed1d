"""The mesh at the start and at a time of the case, as a picture: ``python plot.py 0.25 mesh.png``."""

import re
import sys
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.collections import PolyCollection

CASE = Path(__file__).parent


def points_of(folder):
    """Coordinates in a polyMesh folder of a time."""
    body = re.search(r"\n\s*\d+\s*\n\((.*?)\n\)", (CASE / folder / "polyMesh" / "points").read_text(), re.DOTALL)
    return np.array(re.sub(r"[()]", " ", body[1]).split(), dtype=float).reshape(-1, 3)


def main(time, picture):
    """Draw the faces of the plane in front."""
    start, moved = points_of("constant"), points_of(time)
    text = (CASE / "constant/polyMesh/faces").read_text()
    faces = np.array([face.split() for face in re.findall(r"\n4\(([\d ]+)\)", text)], dtype=int)
    plane = faces[(start[faces, 2] > start[:, 2].mean()).all(axis=1)]
    figure, axes = plt.subplots(2, 1, figsize=(8, 8), constrained_layout=True)
    for axis, points, title in zip(axes, (start, moved), ("start", f"time {time}"), strict=True):
        axis.add_collection(PolyCollection(points[plane][:, :, :2], facecolors="none", edgecolors="k", linewidths=0.4))
        axis.set(xlim=(0, 2), ylim=(0, 1), aspect="equal", title=title)
    figure.savefig(picture, dpi=90)


if __name__ == "__main__":
    main(*sys.argv[1:])

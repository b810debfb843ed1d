"""Cases meshed by OpenFOAM's own programs, and the results of checkMesh."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

_HEAD = "FoamFile {{ version 2.0; format ascii; class dictionary; object {name}; }}\n"
_CONTROL = """
application none; startFrom startTime; startTime 0; stopAt endTime; endTime 1; deltaT 1; writeControl timeStep;
writeInterval 1; writeFormat {format}; writePrecision 17; writeCompression {compression}; timePrecision 6;
"""
_SCHEMES = "divSchemes {} gradSchemes {} laplacianSchemes {} interpolationSchemes {} snGradSchemes {} ddtSchemes {}\n"
BOX = """
vertices ((0 0 0) (2 0 0) (2 1 0) (0 1 0) (0 0 1.5) (2 0 1.5) (2 1 1.5) (0 1 1.5));
blocks (hex (0 1 2 3 4 5 6 7) (6 4 5) simpleGrading (2 1 3));
boundary (
  low { type wall; faces ((0 3 2 1)); } high { type patch; faces ((4 5 6 7)); } none { type patch; faces (); }
  sides { type patch; faces ((0 4 7 3) (1 2 6 5) (0 1 5 4) (3 7 6 2)); }
);
"""
PRISMS = """
vertices ((0 0 0) (1 0 0) (0 1 0) (0 0 2) (1 0 2) (0 1 2));
blocks (hex (0 1 2 2 3 4 5 5) (3 2 4) simpleGrading (1 1 1));
boundary (all { type wall; faces ((0 2 2 1) (3 4 5 5) (0 1 4 3) (1 2 5 4) (2 0 3 5)); });
"""
STRIP = """
vertices ((0 0 -1) (3 0 -1) (3 2 -1) (1 2 -1) (0 0 1) (3 0 1) (3 2 1) (1 2 1));
blocks (hex (0 1 2 3 4 5 6 7) (6 4 1) simpleGrading (2 1 1));
boundary (
  inlet { type patch; faces ((0 4 7 3)); } outlet { type patch; faces ((1 2 6 5)); }
  walls { type wall; inGroups (wall); faces ((0 1 5 4) (3 7 6 2)); }
  back { type empty; faces ((0 3 2 1)); } front { type empty; faces ((4 5 6 7)); }
);
"""
WEDGE = """
vertices ((0 0 0) (1 0 0) (1 1 -0.1) (0 1 -0.1) (1 1 0.1) (0 1 0.1));
blocks (hex (0 1 2 3 0 1 4 5) (4 3 1) simpleGrading (1 1 1));
boundary (
  back { type wedge; faces ((0 3 2 1)); } front { type wedge; faces ((0 1 4 5)); }
  rest { type patch; faces ((0 5 3 0) (1 2 4 1) (3 5 4 2)); }
);
"""
SNAPPY = """
castellatedMesh true; snap true; addLayers false;
geometry { ball { type searchableSphere; centre (1 0.5 0.75); radius 0.3; } }
castellatedMeshControls {
  maxLocalCells 10000; maxGlobalCells 10000; minRefinementCells 0; nCellsBetweenLevels 1; features ();
  refinementSurfaces { ball { level (1 1); patchInfo { type wall; } } }
  resolveFeatureAngle 30; refinementRegions {} locationInMesh (0.123 0.123 0.123); allowFreeStandingZoneFaces true;
}
snapControls { nSmoothPatch 3; tolerance 2; nSolveIter 20; nRelaxIter 5; }
addLayersControls {
  relativeSizes true; layers {} expansionRatio 1; finalLayerThickness 0.3; minThickness 0.1; nGrow 0; featureAngle 60;
  nRelaxIter 3; nSmoothSurfaceNormals 1; nSmoothNormals 3; nSmoothThickness 10; maxFaceThicknessRatio 0.5;
  maxThicknessToMedialRatio 0.3; minMedianAxisAngle 90; nBufferCellsNoExtrude 0; nLayerIter 50;
}
meshQualityControls {
  maxNonOrtho 65; maxBoundarySkewness 20; maxInternalSkewness 4; maxConcave 80; minVol 1e-13; minTetQuality 1e-15;
  minArea -1; minTwist 0.02; minDeterminant 0.001; minFaceWeight 0.05; minVolRatio 0.01; minTriangleTwist -1;
  nSmoothScale 4; errorReduction 0.75;
}
mergeTolerance 1e-6;
"""


@dataclass
class FoamCase:
    folder: Path
    output: str = ""

    @classmethod
    def new(cls, folder: Path, blocks: str = "", *, form: str = "ascii", compression: str = "off") -> FoamCase:
        if shutil.which("checkMesh") is None:
            pytest.skip("OpenFOAM is not installed (Debian: openfoam)")
        control = _CONTROL.format(format=form, compression=compression)
        files = {"controlDict": control, "fvSchemes": _SCHEMES, "fvSolution": "", "snappyHexMeshDict": SNAPPY}
        if blocks:
            files["blockMeshDict"] = "scale 1;\n" + blocks
        (folder / "system").mkdir(parents=True)
        for name, text in files.items():
            (folder / "system" / name).write_text(_HEAD.format(name=name) + text)
        return cls(folder)

    def run(self, *command: str) -> str:
        root = os.environ.get("WM_PROJECT_DIR", "/usr/share/openfoam")
        environment = os.environ | {"FOAM_ETC": f"{root}/etc", "WM_PROJECT_DIR": root, "PWD": str(self.folder)}
        done = subprocess.run(
            command, cwd=self.folder, env=environment, capture_output=True, text=True, check=False, timeout=120
        )
        self.output = done.stdout + done.stderr
        assert done.returncode == 0, f"{command}\n{self.output[-3000:]}"
        return self.output

    def checked(self) -> dict[str, float]:
        text = self.run("checkMesh", "-constant", "-allGeometry", "-allTopology")
        found = {}
        for name in ("points", "faces", "internal faces", "cells", "hexahedra", "prisms", "pyramids", "tetrahedra",
                     "polyhedra", "wedges", "tet wedges"):  # fmt: skip
            match = re.search(rf"(?m)^ +{name}: +(\d+)$", text)
            found[name] = int(match[1]) if match else 0
        for name, pattern in (
            ("volume", r"Total volume = ([\d.e+-]+)"),
            ("least volume", r"Min volume = ([\d.e+-]+)"),
            ("least area", r"Minimum face area = ([\d.e+-]+)"),
            ("greatest area", r"Maximum face area = ([\d.e+-]+)"),
        ):
            match = re.search(pattern, text)
            assert match is not None, text
            found[name] = float(match[1].rstrip("."))
        return found

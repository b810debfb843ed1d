"""OpenFOAM: its file format, the polyMesh, and one layer of cells as a plane mesh."""

"""OpenFOAM's mesh motion, driven through case files: no OpenFOAM header or binding is needed."""

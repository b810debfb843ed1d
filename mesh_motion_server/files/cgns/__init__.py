"""CGNS: the zone, its boundary conditions, elements and faces, and the tree of nodes in HDF5."""

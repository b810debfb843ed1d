"""A region of a mesh whose other cells are in other processes, and the data about those cells that a correction needs.

A correction that frees the nodes of bad cells gets those cells and some rings around them. Its positions are bitwise
those of a correction with the whole mesh, if it frees no node that has cells elsewhere, and if no cell elsewhere is
nearly bad. Otherwise :class:`RegionTooSmall` is raised, and a larger region must be tried.
"""

from dataclasses import dataclass

import numpy as np

from mesh_motion_numerics.arrays import Integers, Marks


class RegionTooSmall(Exception):
    """The correction would free nodes that have cells elsewhere.

    Parameters
    ----------
    nodes : (k,) int64 array
        Indices of these nodes.
    """

    def __init__(self, nodes: Integers) -> None:
        super().__init__("the region is too small")
        self.nodes = nodes


@dataclass(frozen=True, eq=False)
class Elsewhere:
    """The rest of a mesh."""

    rim: Marks  # (n,). Nodes of the region that have cells elsewhere
    free: int  # Number of nodes elsewhere that a correction might free
    #: (float, float). The smallest relative skew and the smallest size of the cells elsewhere.
    extremes: tuple[float, float]

    def require_here(self, free: Marks) -> None:
        """Raise RegionTooSmall if a node (n,) that is to be free has cells elsewhere."""
        nodes = np.flatnonzero(free & self.rim)
        if len(nodes):
            raise RegionTooSmall(nodes)

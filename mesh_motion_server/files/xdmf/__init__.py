"""XDMF, versions 2 and 3: uniform grids and collections of them, with numbers in the file, in HDF5 or in raw files.

XDMF has no patches: they are made from arrays, as for VTK's files. A grid with the mesh's points and cells of lower
dimension, as FEniCS writes its tags, has numbered patches under any array name.

https://www.xdmf.org/index.php/XDMF_Model_and_Format
"""

import re

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.xdmf.grids import read
from mesh_motion_server.files.xdmf.moving import move

__all__ = ["XDMF"]

XDMF = Format("an XDMF file", (".xdmf", ".xmf", ".xdmf2", ".xdmf3"), re.compile(rb"<Xdmf\b"), read, move=move)

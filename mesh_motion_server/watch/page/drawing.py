"""The picture of a session's mesh for the page."""

from io import BytesIO
from pathlib import Path

import matplotlib.figure  # noqa: F401  (loaded with this module, so that the time of a picture is the drawing's)
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.session.journal.mesh_store import MESH
from mesh_motion_server.watch.pictures.before_after import draw_after
from mesh_motion_server.watch.pictures.meshes import read_pair
from mesh_motion_server.watch.pictures.page import Page, styled
from mesh_motion_server.watch.pictures.palette import DARK, LIGHT

#: A larger mesh file is not read: it would exceed the memory of the process.
_MESH_BYTES = 192 << 20
_WIDTH_MM, _DPI = 125.0, 200


def draw(session_folder: Path, *, dark: bool) -> bytes:
    """PNG of the stored mesh.

    Raises InvalidInput if it is too large, or has one dimension. Raises DataLoss if the files do not verify.
    """
    mesh = session_folder / MESH
    if mesh.exists() and mesh.stat().st_size > _MESH_BYTES:
        raise InvalidInput("the mesh is too large to be drawn here")
    page, file = Page(_WIDTH_MM, theme=DARK if dark else LIGHT, dpi=_DPI), BytesIO()
    with styled(page):
        draw_after(read_pair(session_folder), page).savefig(file, format="png", dpi=page.dpi)
    return file.getvalue()

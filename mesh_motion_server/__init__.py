"""The mesh-motion server: predicts mesh quality and corrects the motion before any node moves."""

from mesh_motion_protocol import __version__

__all__ = ["__version__"]

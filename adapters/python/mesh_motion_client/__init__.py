"""Client of the mesh-motion server."""

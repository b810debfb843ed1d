"""Measurements of the mesh-motion server against other systems; development only, never installed."""

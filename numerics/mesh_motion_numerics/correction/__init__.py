"""Corrections of a predicted motion: freed nodes, enrichment functions, and the distortion that they minimise."""

"""Corrections of a predicted motion: freed nodes, enrichment functions, and what they lower."""

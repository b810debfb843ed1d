"""Quality of cells: as they are, as a displacement would make them, and in summary."""

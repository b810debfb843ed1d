"""Quality of cells: now, after a planned displacement, and in summary."""

"""Studies beyond the thesis, measured on cases that were not used to tune the methods."""

"""What goes beyond the thesis, measured on cases that the methods were not tuned on."""

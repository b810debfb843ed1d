"""VTK: its legacy and XML files, the pieces of one mesh, and the writer of .vtu and its series."""

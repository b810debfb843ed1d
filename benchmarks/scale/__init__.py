"""How set-up, step, coupling iteration and memory grow with the mesh, in the library and over the wire."""

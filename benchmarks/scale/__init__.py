"""Growth of set-up, step, coupling iteration and memory with the mesh, in the library and over the network."""

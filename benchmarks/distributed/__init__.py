"""What partitions on workers cost, and what that says of meshes that no machine here can hold."""

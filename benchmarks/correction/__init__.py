"""The cost of a correction: what it frees, how long it takes, how much memory, and how near that is to the least."""

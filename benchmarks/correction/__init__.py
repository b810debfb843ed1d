"""The cost of a correction: freed nodes, time, memory, and the ratio of its time to the minimum."""

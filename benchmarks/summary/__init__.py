"""All benchmarks in one run, within a given time, and one page with the aims and the measured values."""

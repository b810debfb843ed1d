"""Tests; other tests, benchmarks and separate processes import `tests.faults` by its name."""

"""Tests; `tests.faults` is imported by its name: by other tests, benchmarks, and processes of their own."""

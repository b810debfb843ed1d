"""All benchmarks in one run, within a given time, and one page that says what was asked for and what was measured."""

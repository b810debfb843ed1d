"""``python -m benchmarks``: everything in one run, see :mod:`benchmarks.summary`."""

from benchmarks.summary.command import main

if __name__ == "__main__":
    main()

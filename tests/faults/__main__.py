"""``python -m tests.faults``: run the rows with pytest, one line for each row; all options of pytest are allowed."""

import signal
import sys
from pathlib import Path

import pytest

#: One table: no dots, no heading, a row's traceback at the end.
_OPTIONS = ("-m", "faults", "-q", "-s", "--no-header", "--no-summary", "-p", "no:cacheprovider", "-p", "no:logging")


def main(*arguments: str) -> int:
    """The status is 1 if a row fails; SIGTERM is an interrupt like Ctrl-C: servers and clients of a row end with it."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    return int(pytest.main([*_OPTIONS, *arguments, str(Path(__file__).with_name("test_rows.py"))]))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

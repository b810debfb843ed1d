"""Python in its own process."""

import subprocess
import sys
from typing import Any


def said_by_python(*arguments: object, **options: Any) -> str:
    """Return the standard output of ``python ARGUMENTS``; if it does not succeed, the test fails with its errors."""
    site = ["-S"] if sys.flags.no_site else []  # the same packages as in this process
    command = [sys.executable, *site, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout

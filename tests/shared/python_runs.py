"""Python in a process of its own."""

import subprocess
import sys
from typing import Any


def said_by_python(*arguments: object, **options: Any) -> str:
    """Standard output of ``python ARGUMENTS``, which ends well; if not, the test fails with its errors."""
    site = ["-S"] if sys.flags.no_site else []  # the same packages as here
    command = [sys.executable, *site, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout

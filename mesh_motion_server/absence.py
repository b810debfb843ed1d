"""Whether a file is missing, which decides what is removed or written: an error of the disk must not count as missing.

``Path.exists()`` and similar calls return False for a dangling link, and from Python 3.14 on for every error, such as
EIO and ESTALE.
"""

from pathlib import Path


def is_missing(path: Path) -> bool:
    """Whether no entry has this name, not even a dangling link. Raises OSError if the disk gives no answer."""
    try:
        path.lstat()
    except FileNotFoundError:
        return True
    return False

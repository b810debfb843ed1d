"""Whether a file is missing, which decides what is removed or written: an error of the disk is no missing file.

``Path.exists()`` and its kin take a dangling link for a missing file, and from Python 3.14 on every error, such as EIO
and ESTALE.
"""

from pathlib import Path

__all__ = ["is_missing"]


def is_missing(path: Path) -> bool:
    """Whether nothing has this name, not even a dangling link.

    Raises
    ------
    OSError
        If the disk gives no answer.
    """
    try:
        path.lstat()
    except FileNotFoundError:
        return True
    return False

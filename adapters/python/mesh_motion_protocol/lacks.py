"""The way out of errors of the operating system, where a process lacks something."""

import errno

__all__ = ["way_out_of"]

_WAYS_OUT = {
    errno.EMFILE: "allow more open files: ulimit -n",
    errno.ENFILE: "end programs that have many files open, or raise fs.file-max of this machine",
    errno.EAGAIN: "allow more processes: ulimit -u, or the limit of the container",
    errno.ENOMEM: "end other programs, or give this machine more memory",
}


def way_out_of(error: OSError, otherwise: str) -> str:
    """The hint for an error: its own for a lack of files, processes or memory, otherwise the given one."""
    return _WAYS_OUT.get(error.errno or 0, otherwise)

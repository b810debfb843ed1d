"""The state folder belongs to one server at a time, and to one user."""

import errno
import fcntl
import json
import os
import socket
import stat
from pathlib import Path
from typing import Any

from mesh_motion_protocol.errors import MeshMotionError, ResourceExhausted

from mesh_motion_server.session.journal.filesystem import PosixFileSystem, make_durable_folder
from mesh_motion_server.transport.endpoints import EndpointError

_LOCK = "server.lock"
#: Errors of file systems that lock no folder.
_NO_LOCK = {errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL, errno.EBADF, errno.ENOSYS}


class StateFolder:
    """The state folder, held by this process until it ends.

    The kernel ends the locks together with their process: after a crash the folder is unlocked. The folder itself is
    locked too, because its file may be removed while the server runs. Raises EndpointError if other users may write to
    the folder, or put another in its place. Raises ResourceExhausted: UNAVAILABLE while another server holds the
    folder; RESOURCE_EXHAUSTED.DISK if the system refuses.

    Parameters
    ----------
    root : Path
        The folder; made with mode 0700 if it is missing.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        try:
            make_durable_folder(PosixFileSystem(), root)
            for folder in (root, root / "sessions"):
                _require_own(folder)
            _require_in_place(root)
            self._folder = os.open(root, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        except OSError as error:
            raise _refused(root, error) from error
        try:
            self._lock = self._locked()
        except BaseException:
            os.close(self._folder)
            raise

    def _locked(self) -> int:
        """The lock's file, both locked."""
        try:
            fcntl.flock(self._folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise _held(self._root, _holder(self._root / _LOCK)) from None
        except OSError as error:
            if error.errno not in _NO_LOCK:
                raise _refused(self._root, error) from error
        try:
            lock = os.open(self._root / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        except OSError as error:
            raise _refused(self._root, error, f"its file {_LOCK}: ") from error
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(lock)
            if isinstance(error, BlockingIOError):
                raise _held(self._root, _holder(self._root / _LOCK)) from None
            raise _refused(self._root, error, f"its file {_LOCK}: ") from error
        return lock

    def name_holder(self, endpoint: str) -> None:
        """Write this server as the holder, for the error of another server.

        Raises ResourceExhausted: RESOURCE_EXHAUSTED.DISK if the disk cannot store it.
        """
        text = json.dumps({"pid": os.getpid(), "host": socket.gethostname(), "endpoint": endpoint}).encode()
        try:
            os.pwrite(self._lock, text, 0)
            os.ftruncate(self._lock, len(text))
        except OSError as error:
            raise _refused(self._root, error, f"its file {_LOCK}: ") from error

    def release(self) -> None:
        """Let another server hold the folder."""
        os.close(self._lock)
        os.close(self._folder)


def _require_own(folder: Path) -> None:
    """Raise if other users may change the content of a folder, or the target of a link in its place."""
    try:
        entry, found = folder.lstat(), folder.stat()
    except FileNotFoundError:
        if folder.is_symlink():
            raise EndpointError(f"{folder} is a link without a target", hint="give a folder as --state") from None
        return
    mode = stat.S_IMODE(found.st_mode)
    if mode & 0o022:
        raise EndpointError(
            f"other users may write to {folder}: its mode must be 0700, got {mode:04o}",
            hint=f"chmod 700 {folder}, and check it for files of other users",
        )
    strangers = {entry.st_uid, found.st_uid} - {os.geteuid(), 0}
    if strangers:
        raise EndpointError(
            f"{folder} must belong to user {os.geteuid()}, who runs the server, got user {min(strangers)}",
            hint="chown it, or give another --state",
        )


def _require_in_place(root: Path) -> None:
    """Raise if every user may put another folder in the place of the state folder, or of a folder above it.

    A folder that a group may write to is accepted, because folders of projects are often of this kind.
    """
    for folder in dict.fromkeys((*root.absolute().parents, *root.resolve().parents)):
        mode = stat.S_IMODE(folder.stat().st_mode)
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            raise EndpointError(
                f"all users may rename {root}: {folder} has mode {mode:04o}, expected no right to write for others",
                hint=f"chmod o-w {folder}, or chmod +t {folder}, or give another --state",
            )


def _holder(path: Path) -> str:
    """The holder in the lock file; if it cannot be read, a text that says so."""
    try:
        found: dict[str, Any] = json.loads(path.read_bytes())
        return f"process {found['pid']} on {found['host']}, endpoint {found['endpoint']}"
    except FileNotFoundError:
        return f"its file {path} was removed, so its process is not known"
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return "its process is just starting"


def _held(root: Path, holder: str) -> ResourceExhausted:
    return ResourceExhausted(
        f"the state folder {root} is held by another server: {holder}",
        code="UNAVAILABLE",
        hint="use that server, stop it first, or give another --state",
    )


def _refused(root: Path, error: OSError, what: str = "") -> MeshMotionError:
    taken = isinstance(error, FileExistsError)
    reason = "it is a file, or a link without a target" if taken else error.strerror or error
    return ResourceExhausted(
        f"the state folder {root} cannot be used: {what}{reason}",
        code="RESOURCE_EXHAUSTED.DISK",
        hint="check the disk and the rights of the folder, or give another --state",
    )

"""Runs a call in its own thread while the caller continues: the disk works while cells are judged."""

import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Generic, TypeVar

_Result = TypeVar("_Result")


class BackgroundCall(Generic[_Result]):
    """Runs a call in its own thread, at once; if there is no memory for a thread, in the caller's thread.

    Parameters
    ----------
    call : callable
        Must not change data that the caller uses before :meth:`result`.
    worth_a_thread : bool
        If false, the call runs before the constructor returns.
    """

    def __init__(self, call: Callable[[], _Result], *, worth_a_thread: bool = True) -> None:
        self._call = call
        self._found: list[_Result] = []
        self._error: BaseException | None = None
        self._thread: threading.Thread | None = None
        if worth_a_thread:
            with suppress(RuntimeError):
                thread = threading.Thread(target=self._run, name="background", daemon=True)
                thread.start()
                self._thread = thread
        if self._thread is None:
            self._run()

    def wait(self) -> None:
        """Wait until the call has ended, successfully or not."""
        if self._thread is not None:
            self._thread.join()

    def result(self) -> _Result:
        """Wait for the call; return its result or raise its error."""
        self.wait()
        if self._error is not None:
            raise self._error
        return self._found[0]

    def _run(self) -> None:
        try:
            self._found.append(self._call())
        except BaseException as error:
            self._error = error

"""A replacement for a function that fails."""

from collections.abc import Callable
from typing import Any, NoReturn


def raising(error: BaseException) -> Callable[..., NoReturn]:
    """Return a function with any arguments that raises this error."""

    def fail(*_: Any, **__: Any) -> NoReturn:
        raise error

    return fail

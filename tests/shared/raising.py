"""What stands in place of a function that fails."""

from collections.abc import Callable
from typing import Any, NoReturn


def raising(error: BaseException) -> Callable[..., NoReturn]:
    """A function of any arguments that raises this error."""

    def fail(*_: Any, **__: Any) -> NoReturn:
        raise error

    return fail

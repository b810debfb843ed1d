"""The form of a row of the tables of bad and extreme inputs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tests.faults.inputs.drafts import Draft, Part

Rng = np.random.Generator
#: The details that an error must have; a callable checks a value whose last digits may differ.
Names = Mapping[str, Any]
Where = Literal["upload", "build", "move"]
#: Spoils a draft, or returns the part to be sent as well; a case draws at random which node, row or axis it spoils.
Spoiler = Callable[[Draft, Rng], "Names | tuple[Part, Names]"]


@dataclass(frozen=True)
class BadInput:
    """One bad input and its expected answer.

    ``where`` ({"upload", "build", "move"}): the request that must be refused; earlier requests are answered as
    in a good session; ``spoil``: changes the good draft, and returns the expected error details. For an upload it
    returns the bad part too, which is sent after the good ones; ``code``: on the wire; ``says``: text that the message
    must contain; ``draft``: name of the good session; ``mended``: for "build": a part is missing; after its upload the
    mesh is that of the good session; ``settings``: settings of the good session too.
    """

    name: str
    where: Where
    spoil: Spoiler
    code: str
    says: tuple[str, ...] = ()
    draft: str = "square"
    mended: bool = False
    settings: Mapping[str, Any] | None = None


def spoilt(
    name: str, where: Where, code: str, change: Callable[[Draft], Any], names: Names, *says: str, draft: str = "square"
) -> BadInput:
    def spoil(spoiled: Draft, rng: Rng) -> Names:
        change(spoiled)
        return names

    return BadInput(name, where, spoil, code, says, draft)


def unfit(first: str, draft: str = "square", /, **settings: Any) -> BadInput:
    """Settings that do not fit the mesh; the error names the ``first``."""
    name = f"{draft} at build with " + ", ".join(f"{key} = {value}" for key, value in settings.items())
    code, names = "INVALID_ARGUMENT.SETTINGS", {"setting": first}
    return spoilt(name, "build", code, lambda spoiled: spoiled.set_settings(**settings), names, first, draft=draft)

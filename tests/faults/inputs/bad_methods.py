"""BUILD where every setting is admissible, and the mesh too, but not both together."""

from typing import Any

from tests.faults.inputs.cases import BadInput, Names, Rng
from tests.faults.inputs.drafts import Draft


def _unfit(first: str, draft: str = "square", /, **settings: Any) -> BadInput:
    """Settings that do not go together on this mesh; the error names the ``first``."""

    def spoil(spoiled: Draft, rng: Rng) -> Names:
        spoiled.set_settings(**settings)
        return {"setting": first}

    chosen = ", ".join(f"{key} = {value}" for key, value in settings.items())
    return BadInput(f"{draft} with {chosen}", "build", spoil, "INVALID_ARGUMENT.SETTINGS", (first,), draft=draft)


def _on_a_line(draft: Draft, rng: Rng) -> Names:
    """The nodes with a role lie on one line: they determine no linear polynomial in the plane."""
    draft.drop("patch", "walls")
    draft.set_settings(basis="tps")
    return {"setting": "basis"}


BAD_METHODS = (
    _unfit("support_radius", basis="gauss"),
    _unfit("support_radius", basis="imqb"),
    _unfit("support_radius", support_radius=1e300),
    _unfit("support_radius", support_radius=1.1e12),
    _unfit("support_radius", "cube", support_radius=1e300),
    _unfit("support_radius", support_radius=1e-300),
    _unfit("support_radius", support_radius=5e-324),
    _unfit("enrichment_radius", enrichment_radius=1e-300),
    _unfit("enrichment_radius", enrichment_radius=1e300),
    BadInput("a plane spline on a line of nodes", "build", _on_a_line, "INVALID_ARGUMENT.SETTINGS", ("basis",)),
    _unfit("basis", "line", correction="imposed-gradient", basis="wendland-c0"),
    _unfit("basis", "periodic", basis="tps"),
    _unfit("reduction", "periodic", reduction="greedy"),
)

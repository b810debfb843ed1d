"""BUILD with allowed settings and an allowed mesh that do not fit together."""

from tests.faults.inputs.cases import spoilt, unfit
from tests.faults.inputs.drafts import Draft


def _on_a_line(draft: Draft) -> None:
    """The nodes with a role lie on one line: they determine no linear polynomial in the plane."""
    draft.drop("patch", "walls")
    draft.set_settings(basis="tps")


BAD_METHODS = (
    unfit("support_radius", basis="gauss"),
    unfit("support_radius", basis="imqb"),
    unfit("support_radius", support_radius=1e300),
    unfit("support_radius", support_radius=1.1e12),
    unfit("support_radius", "cube", support_radius=1e300),
    unfit("support_radius", support_radius=1e-300),
    unfit("support_radius", support_radius=5e-324),
    unfit("enrichment_radius", enrichment_radius=1e-300),
    unfit("enrichment_radius", enrichment_radius=1e300),
    spoilt(
        "a plane spline on a line of nodes",
        "build",
        "INVALID_ARGUMENT.SETTINGS",
        _on_a_line,
        {"setting": "basis"},
        "basis",
    ),
    unfit("basis", "line", correction="imposed-gradient", basis="wendland-c0"),
    unfit("basis", "periodic", basis="tps"),
    unfit("reduction", "periodic", reduction="greedy"),
)

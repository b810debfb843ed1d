"""Finds the extra of the package that installs a missing module.

The package's metadata list what each extra requires, so there is no second table.
"""

from __future__ import annotations

import re

_PACKAGE = "mesh-motion-server"
#: Extras that contain packages of other extras; the smallest extra that installs a module is named.
_COLLECTIONS = ("all", "dev")
_REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+).*;.*\bextra == ['\"]([\w-]+)['\"]")


def extra_of(module: str) -> str | None:
    """Return the extra that installs a module; None if none does.

    Parameters
    ----------
    module : str
        Name of the module as it is imported, ``package.module``.
    """
    wanted = module.partition(".")[0].lower().replace("_", "-")
    for line in _requirements():
        found = _REQUIREMENT.match(line)
        if found and found[2] not in _COLLECTIONS and found[1].lower().replace("_", "-") == wanted:
            return found[2]
    return None


def not_installed(error: ModuleNotFoundError) -> str | None:
    """Return one line with the module and the command that installs it; None if no extra installs it."""
    extra, listed = extra_of(error.name or ""), _requirements()
    if extra is None and listed:
        return None
    if not listed:  # Python finds the folder of the sources: a checkout is the working folder
        return f"{_PACKAGE} is not installed, only its sources are here (pip install '.[server]' in their folder)"
    return f"the package {error.name!r} is not installed (pip install '{_PACKAGE}[{extra}]')"


def _requirements() -> list[str]:
    """The package's requirements, none if it is not installed."""
    from importlib.metadata import PackageNotFoundError, requires  # noqa: PLC0415  (40 ms that no command needs)

    try:
        return requires(_PACKAGE) or []
    except PackageNotFoundError:
        return []

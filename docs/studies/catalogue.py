"""Every study by name: the modules of the pages' packages that have a ``STUDY``."""

from __future__ import annotations

import pkgutil
from importlib import import_module

from docs.studies.study import Study

__all__ = ["PAGES", "names", "study"]

PAGES = ("thesis", "beyond", "run", "explained", "choosing")
"""Sub-packages; ``docs/<page>.md`` shows their studies."""


def names(page: str) -> list[str]:
    """The studies of a page, sorted; modules that begin with an underscore are shared by several studies."""
    package = import_module(f"docs.studies.{page}")
    return sorted(m.name for m in pkgutil.iter_modules(package.__path__) if not m.name.startswith("_"))


def study(page: str, name: str) -> Study:
    """The study of a page by its module's name."""
    found = import_module(f"docs.studies.{page}.{name}").STUDY
    if not isinstance(found, Study):
        raise TypeError(f"docs.studies.{page}.{name}.STUDY: expected a Study, got {type(found).__name__}")
    return found

"""The parts of the reference pages that are generated from the code, so that they agree with it.

A page has ``<!-- generated: NAME -->`` and ``<!-- end -->`` around such a part; :data:`PARTS` has the function that
writes it, as Markdown. ``python -m docs.site.reference`` updates the pages (``make manual``); a test checks that they
are current.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable
from functools import partial

from docs.site.reference.benchmarks import benchmark
from docs.site.reference.c_header import c_header
from docs.site.reference.commands import commands
from docs.site.reference.error_codes import error_codes, exit_statuses
from docs.site.reference.fortran_module import fortran_module
from docs.site.reference.messages import messages
from docs.site.reference.metrics import metrics
from docs.site.reference.python_client import python_client
from docs.site.reference.settings import case_file, method_keys, method_settings, server_settings

__all__ = ["PARTS", "filled", "without_parts"]

PARTS: dict[str, Callable[[], str]] = {
    **{f"benchmark-{name}": partial(benchmark, name) for name in ("front", "aims", "scale", "correction")},
    "c-header": c_header,
    "case-file": case_file,
    "commands": commands,
    "error-codes": error_codes,
    "exit-statuses": exit_statuses,
    "fortran-module": fortran_module,
    "messages": messages,
    "method-keys": method_keys,
    "method-settings": method_settings,
    "metrics": metrics,
    "python-client": python_client,
    "server-settings": server_settings,
}

#: Characters of a line.
_WIDTH = 160
#: The characters before the text of a list's item.
_ITEM = re.compile(r" *(?:- )?")
_wrap = partial(textwrap.wrap, width=_WIDTH, break_long_words=False, break_on_hyphens=False)
_PART = re.compile(r"^(<!-- generated: ([a-z-]+) -->)\n(.*?)(<!-- end -->)$", re.MULTILINE | re.DOTALL)


def filled(text: str) -> str:
    """A page's text with its generated parts up to date.

    Raises
    ------
    KeyError
        If the page names an unknown part.
    """
    return _PART.sub(lambda found: f"{found[1]}\n\n{_wrapped(PARTS[found[2]]().strip())}\n\n{found[4]}", text)


def _wrapped(text: str) -> str:
    """Break long lines, except rows of tables and blocks of code."""
    lines, is_code = [], False
    for line in text.split("\n"):
        is_code ^= line.lstrip().startswith("```")
        indent = " " * len(_ITEM.match(line)[0])  # type: ignore[index]  # matches every line
        is_prose = len(line) > _WIDTH and not is_code and not line.startswith("|")
        lines += _wrap(line, subsequent_indent=indent) if is_prose else [line]
    return "\n".join(lines)


def without_parts(text: str) -> str:
    """A page's text with empty lines in place of its generated parts."""
    return _PART.sub(lambda found: "\n" * found[0].count("\n"), text)

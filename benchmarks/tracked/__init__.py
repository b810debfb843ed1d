"""Figures of the product over its commits, by asv (https://asv.readthedocs.io): ``make track``.

asv installs each commit in a separate environment and runs today's benchmarks there. It puts the parent folder on the
path, so :mod:`mesh_motion_server` belongs to the tested commit. This module makes ``benchmarks`` importable from this
checkout, without the checkout's server.
"""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

_FOLDER = Path(__file__).resolve().parents[1]

if "benchmarks" not in sys.modules:
    spec = spec_from_file_location("benchmarks", _FOLDER / "__init__.py", submodule_search_locations=[str(_FOLDER)])
    assert spec is not None
    assert spec.loader is not None
    sys.modules["benchmarks"] = module_from_spec(spec)
    spec.loader.exec_module(sys.modules["benchmarks"])

"""Makes the meshes of the numerics' tests, and what these tests share, importable under pytest's importlib mode."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "numerics")]

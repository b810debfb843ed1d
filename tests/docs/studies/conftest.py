"""Makes the meshes of the numerics' tests importable, and the helpers of this folder."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "numerics")]

"""``python -m mesh_motion_precice``."""

import sys

from mesh_motion_precice.command import main

sys.exit(main())

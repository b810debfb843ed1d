"""``python -m mesh_motion_server`` is ``mesh-motion``."""

from mesh_motion_server.commands.cli import main

if __name__ == "__main__":
    main()

#!/usr/bin/env bash
# Makes a Python environment with Kratos and the client's requirements, once, and prints its interpreter: 69 MB of
# wheels, and numpy's; 330 MB on the disk. PYTHON chooses another Python than python3, the first argument another
# folder.
set -euo pipefail
folder="${1:-${XDG_CACHE_HOME:-$HOME/.cache}/mesh-motion/kratos-10.4}"
python="$folder/bin/python"
if ! "$python" -c "import zmq, msgpack, KratosMultiphysics" >/dev/null 2>&1; then
  rm -rf "$folder"
  "${PYTHON:-python3}" -m venv "$folder"
  "$python" -m pip install --quiet --disable-pip-version-check numpy msgpack pyzmq "KratosMultiphysics==10.4.*" \
    Kratos{MeshMoving,LinearSolvers,FluidDynamics,StructuralMechanics,CoSimulation,Mapping}Application==10.4.* >&2
fi
echo "$python"

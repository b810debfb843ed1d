# . environment.sh: sets the environment for Debian's OpenFOAM and for this adapter's library
export FOAM_ETC=${FOAM_ETC:-/usr/share/openfoam/etc} WM_PROJECT_DIR=${WM_PROJECT_DIR:-/usr/share/openfoam}
LD_LIBRARY_PATH=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)/build${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
export LD_LIBRARY_PATH

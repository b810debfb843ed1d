# . environment.sh: what Debian's OpenFOAM needs, and where this adapter's library is
export FOAM_ETC=${FOAM_ETC:-/usr/share/openfoam/etc} WM_PROJECT_DIR=${WM_PROJECT_DIR:-/usr/share/openfoam}
LD_LIBRARY_PATH=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)/build${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
export LD_LIBRARY_PATH

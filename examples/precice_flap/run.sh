#!/usr/bin/env bash
# preCICE's tutorial perpendicular-flap with its OpenFOAM adapter, the mesh-motion server and CalculiX: ./run.sh PREFIX
#
# PREFIX has preCICE and the adapter (build.sh). TUTORIALS names a folder with preCICE's tutorials; without it git
# fetches those tried. MAX_TIME (5), OUT (out/precice_flap), RANKS (1) of OpenFOAM, SUB_STEPS (1) of a window,
# WRITE_INTERVAL (0.1), MOTION (server, or laplacian: the tutorial as it is), SOLID_PYTHON: one that has pyprecice.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
prefix=$(cd "${1:?usage: ./run.sh PREFIX}" && pwd)
out=${OUT:-out/precice_flap}
ranks=${RANKS:-1}
rm -rf "$out"
mkdir -p "$out"
cd "$out"
if [ -z "${TUTORIALS:-}" ]; then
  git clone -q --depth 1 -b v202404.0 https://github.com/precice/tutorials tutorials
  TUTORIALS=tutorials
fi
. "$root/adapters/openfoam/environment.sh"
export LD_LIBRARY_PATH=$prefix/lib:$LD_LIBRARY_PATH

cp -r "$TUTORIALS/perpendicular-flap/fluid-openfoam" fluid
sed "s/<max-time value=\"5\"/<max-time value=\"${MAX_TIME:-5}\"/; s/exchange-directory=\"..\"/exchange-directory=\"$(
  pwd | sed 's/[/&]/\\&/g'
)\"/" "$TUTORIALS/perpendicular-flap/precice-config.xml" >precice-config.xml
sed -i "s/^deltaT .*/deltaT $(awk "BEGIN { print 0.01 / ${SUB_STEPS:-1} }");/
  s/^writeInterval .*/writeInterval ${WRITE_INTERVAL:-0.1};/" fluid/system/controlDict
if [ "${MOTION:-server}" = server ]; then # all that the tutorial needs
  cp "$here/dynamicMeshDict" fluid/constant
fi

mesh-motion serve --endpoint tcp://127.0.0.1:0 --state server.state --ready-file server.ready >log.server 2>&1 &
trap 'kill $(jobs -p) 2>/dev/null' EXIT
until [ -e server.ready ]; do
  kill -0 $! || { cat log.server; exit 1; }
  sleep 0.1
done
MESH_MOTION_ENDPOINT=$(python3 -c 'import json; print(json.load(open("server.ready"))["endpoint"])')
export MESH_MOTION_ENDPOINT

"${SOLID_PYTHON:-python3}" "$here/solid.py" precice-config.xml solid >log.solid 2>&1 &
solid=$!
cd fluid
blockMesh >log.blockMesh
solver=(pimpleFoam)
if [ "$ranks" -gt 1 ]; then
  sed -i "s/^numberOfSubdomains .*/numberOfSubdomains $ranks;/; s/n  *(2 2 1)/n ($ranks 1 1)/" system/decomposeParDict
  decomposePar >log.decomposePar
  solver=(mpirun --allow-run-as-root --oversubscribe -np "$ranks" pimpleFoam -parallel)
fi
"${solver[@]}" >log.pimpleFoam 2>&1 || { tail -n 30 log.pimpleFoam; exit 1; }
wait $solid || { tail -n 5 ../log.solid; exit 1; }
cd ..
awk 'NR > 1 { n++; i += $3 } END { print n " windows, " i / n " iterations each" }' precice-Solid-iterations.log
awk 'NR > 1 { if ($4 > x) { x = $4; t = $1 } } END { print "the tip goes " x " m downstream, at " t " s" }' \
  precice-Solid-watchpoint-Flap-Tip.log
echo "steps of the session: $(grep -ho 'remoteMeshMotion: step [0-9]*' fluid/log.pimpleFoam | tail -n 1 | grep -o '[0-9]*')"

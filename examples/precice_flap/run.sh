#!/usr/bin/env bash
# A tutorial of preCICE with its OpenFOAM adapter, the mesh-motion server and CalculiX: ./run.sh PREFIX [TUTORIAL]
#
# TUTORIAL: perpendicular-flap, multiple-perpendicular-flaps or elastic-tube-3d.
# PREFIX/lib has preCICE and libpreciceAdapterFunctionObject.so. TUTORIALS names a folder with preCICE's tutorials; without it git
# fetches those tried. MAX_TIME (5 s; of the tube 0.01), OUT (out/precice_flap), RANKS (1) of OpenFOAM, SUB_STEPS (1) of a
# window and WRITE_INTERVAL (0.1) of the flaps, CONTINUE (1: a further MAX_TIME from OpenFOAM's last written time, which is
# where the solid ended), MOTION (server, or laplacian: the tutorial as it is), SOLID_PYTHON: one that has pyprecice.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
tutorial=${2:-perpendicular-flap}
prefix=$(cd "${1:?usage: ./run.sh PREFIX [TUTORIAL]}" && pwd)
[ -z "${TUTORIALS:-}" ] || TUTORIALS=$(cd "$TUTORIALS" && pwd)
out=${OUT:-out/precice_flap}
ranks=${RANKS:-1}
[ -n "${CONTINUE:-}" ] || rm -rf "$out"
mkdir -p "$out"
cd "$out"
rm -rf server.ready precice-run
if [ -z "${TUTORIALS:-}" ]; then
  [ -d tutorials ] ||
    git -c advice.detachedHead=false clone -q --depth 1 -b v202404.0 https://github.com/precice/tutorials tutorials
  TUTORIALS=tutorials
fi
. "$root/adapters/openfoam/environment.sh"
[ "${MOTION:-server}" != server ] || env -u OUT "$root/adapters/openfoam/Allwmake" >log.Allwmake
export LD_LIBRARY_PATH=$prefix/lib:$LD_LIBRARY_PATH

[ -n "${CONTINUE:-}" ] || cp -r "$TUTORIALS/$tutorial/fluid-openfoam" fluid
case $tutorial in
perpendicular-flap) patches='{ flap moving; "(inlet|outlet)" fixed; "(upper|lower)Wall" slip; }' solids=(Solid) ;;
multiple-perpendicular-flaps)
  patches='{ "flap[12]" moving; "(inlet|outlet)" fixed; "(upper|lower)Wall" slip; }'
  solids=(Solid-Upstream Solid-Downstream)
  ;;
elastic-tube-3d)
  patches='{ interface moving; "auto[02]" fixed; }' solids=(Solid)
  [ -d fluid/constant/polyMesh ] || cp -r fluid/constant/polyMesh.orig fluid/constant/polyMesh
  ;;
*)
  echo "no tutorial $tutorial; see the head of $0" >&2
  exit 2
  ;;
esac
sed "s/<max-time value=\"5\"/<max-time value=\"${MAX_TIME:-5}\"/; s/<max-time-windows value=\"100\"/<max-time value=\"${MAX_TIME:-0.01}\"/
  s/exchange-directory=\"..\"/exchange-directory=\"$(pwd | sed 's/[/&]/\\&/g')\"/" "$TUTORIALS/$tutorial/precice-config.xml" >precice-config.xml
if [ "$tutorial" != elastic-tube-3d ]; then
  sed -i "s/^deltaT .*/deltaT $(awk "BEGIN { print 0.01 / ${SUB_STEPS:-1} }");/
    s/^writeInterval .*/writeInterval ${WRITE_INTERVAL:-0.1};/" fluid/system/controlDict
fi
[ -z "${CONTINUE:-}" ] || sed -i "s/^startFrom .*/startFrom latestTime;/" fluid/system/controlDict
if [ "${MOTION:-server}" = server ]; then # all that the tutorial needs
  sed "s/^ *patches .*/    patches    $patches/" "$here/dynamicMeshDict" >fluid/constant/dynamicMeshDict
fi

mesh-motion serve --endpoint tcp://127.0.0.1:0 --state server.state --ready-file server.ready >log.server 2>&1 &
trap 'kill $(jobs -p) 2>/dev/null' EXIT
until [ -e server.ready ]; do
  kill -0 $! || { cat log.server; exit 1; }
  sleep 0.1
done
MESH_MOTION_ENDPOINT=$(python3 -c 'import json; print(json.load(open("server.ready"))["endpoint"])')
export MESH_MOTION_ENDPOINT

deck=()
[ "$tutorial" = elastic-tube-3d ] && deck=("$TUTORIALS/$tutorial/solid-calculix/tube.inp")
running=()
for solid in "${solids[@]}"; do
  "${SOLID_PYTHON:-python3}" "$here/solid.py" precice-config.xml "$solid" "$solid" "${deck[@]}" >"log.$solid" 2>&1 &
  running+=($!)
done
cd fluid
[ -d constant/polyMesh ] || blockMesh >log.blockMesh
solver=(pimpleFoam)
if [ "$ranks" -gt 1 ]; then
  sed -i "s/^numberOfSubdomains .*/numberOfSubdomains $ranks;/; s/\bn[[:space:]]*([0-9 ]*)/n ($ranks 1 1)/" system/decomposeParDict
  [ -n "${CONTINUE:-}" ] || decomposePar >log.decomposePar
  solver=(mpirun --allow-run-as-root --oversubscribe -np "$ranks" pimpleFoam -parallel)
fi
"${solver[@]}" >log.pimpleFoam 2>&1 &
running+=($!)
cd ..
echo "$tutorial runs in $PWD: tail -f $PWD/fluid/log.pimpleFoam"
while [ "${#running[@]}" -gt 0 ]; do # preCICE waits for ever for a participant that has ended
  wait -n -p ended "${running[@]}" || { tail -n 15 fluid/log.pimpleFoam; tail -n 5 "${solids[@]/#/log.}"; exit 1; }
  for i in "${!running[@]}"; do [ "${running[i]}" != "$ended" ] || unset "running[i]"; done
done
iterations=(precice-*-iterations.log) # as many in all of them
awk 'NR > 1 { n++; i += $3 } END { print n " windows, " i / n " iterations each" }' "${iterations[0]}"
for log in precice-Solid*-watchpoint-*.log; do # of the tube, what it grew in each window
  awk -v name="${log#precice-}" 'NR == 1 { grown = /DisplacementDelta/; next } { u = grown ? u + $6 : $4 }
    u > x { x = u; t = $1 } END { printf "%s goes %.7g m %s, at %g s\n", name, x, grown ? "outwards" : "downstream", t }' "$log"
done
echo "steps of the session: $(grep -ho 'remoteMeshMotion: step [0-9]*' fluid/log.pimpleFoam | tail -n 1 | grep -o '[0-9]*')"

#!/usr/bin/env bash
# preCICE and its OpenFOAM adapter for Debian's OpenFOAM 1912, which has no wmake: ./build.sh PREFIX
#
# PRECICE_SOURCE and ADAPTER_SOURCE name folders with their sources; without them git fetches the versions tried.
# Needs: git cmake g++ libboost-log-dev libboost-thread-dev libboost-program-options-dev libboost-test-dev
# libeigen3-dev libxml2-dev libopenmpi-dev. Half an hour on two cores; an installed preCICE (pkg-config) is taken.
set -euo pipefail
openfoam=$(cd "$(dirname "$0")/../../adapters/openfoam" && pwd)
prefix=$(mkdir -p "${1:?usage: ./build.sh PREFIX}" && cd "$1" && pwd)
export PKG_CONFIG_PATH=$prefix/lib/pkgconfig:$prefix/lib/x86_64-linux-gnu/pkgconfig:${PKG_CONFIG_PATH:-}
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

# The folder in the variable $1, or a clone of the tag $3 of preCICE's repository $2.
sources() {
  local given=${!1:-}
  [ -n "$given" ] || git clone -q --depth 1 -b "$3" "https://github.com/precice/$2" "$scratch/$2"
  echo "${given:-$scratch/$2}"
}

if ! pkg-config --exists libprecice; then
  from=$(sources PRECICE_SOURCE precice v3.4.1)
  cmake -S "$from" -B "$scratch/build" -DCMAKE_BUILD_TYPE=Release "-DCMAKE_INSTALL_PREFIX=$prefix" -DBUILD_TESTING=OFF \
    -DPRECICE_FEATURE_PETSC_MAPPING=OFF -DPRECICE_FEATURE_PYTHON_ACTIONS=OFF -DCMAKE_INSTALL_LIBDIR=lib
  cmake --build "$scratch/build" -j 2
  cmake --install "$scratch/build"
fi

adapter=$(sources ADAPTER_SOURCE openfoam-adapter v1.3.1)
headers=$("$openfoam/headers.sh")/src
includes=()
for part in OpenFOAM OSspecific/POSIX finiteVolume meshTools surfMesh fileFormats transportModels/incompressible \
  transportModels/compressible transportModels/twoPhaseMixture transportModels/interfaceProperties \
  transportModels/immiscibleIncompressibleTwoPhaseMixture thermophysicalModels/basic \
  TurbulenceModels/turbulenceModels TurbulenceModels/compressible TurbulenceModels/incompressible; do
  includes+=(-isystem "$headers/$part/lnInclude")
done
mapfile -t own < <(find "$adapter" -name '*.H' -printf '-I%h\n' | sort -u)
objects=()
for file in $(grep -v '^LIB' "$adapter/Make/files"); do # as its own wmake does
  objects+=("$scratch/$(basename "$file" .C).o")
  ${CXX:-g++} -std=c++17 -m64 -DOPENFOAM=1912 -DWM_DP -DWM_LABEL_SIZE=32 -DNoRepository -O2 -fPIC -ftemplate-depth-100 \
    "${includes[@]}" -isystem "$headers/transportModels" "${own[@]}" $(pkg-config --cflags libprecice) \
    -c "$adapter/$file" -o "${objects[-1]}"
done
${CXX:-g++} -shared "${objects[@]}" -o "$prefix/lib/libpreciceAdapterFunctionObject.so" -Wl,--no-as-needed \
  -lcompressibleTurbulenceModels -lincompressibleTurbulenceModels -limmiscibleIncompressibleTwoPhaseMixture \
  $(pkg-config --libs libprecice) "-Wl,-rpath,$(pkg-config --variable=libdir libprecice)"
echo "$prefix/lib/libpreciceAdapterFunctionObject.so"

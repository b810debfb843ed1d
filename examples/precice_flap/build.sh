#!/usr/bin/env bash
# Builds preCICE 3.4.1 and its OpenFOAM adapter 1.3.1 into PREFIX, for Debian's OpenFOAM, which has no wmake: ./build.sh PREFIX
#
# PRECICE_SOURCE, ADAPTER_SOURCE: folders with their sources; without them git fetches these. The adapter's headers are those
# of adapters/openfoam/headers.sh.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "${1:?usage: ./build.sh PREFIX}"
prefix=$(cd "$1" && pwd)
openfoam=$here/../../adapters/openfoam
. "$openfoam/environment.sh"

fetched() { # NAME VERSION: the sources of preCICE's repository NAME
  [ -d "$prefix/$1" ] || git -c advice.detachedHead=false clone -q --depth 1 -b "$2" "https://github.com/precice/$1" "$prefix/$1"
  echo "$prefix/$1"
}
adapter=${ADAPTER_SOURCE:-$(fetched openfoam-adapter v1.3.1)}
parts=(transportModels/{incompressible,compressible,twoPhaseMixture,interfaceProperties,immiscibleIncompressibleTwoPhaseMixture}
  thermophysicalModels/basic TurbulenceModels/{turbulenceModels,compressible,incompressible})
source=$("$openfoam/headers.sh" "${parts[@]}")

if [ ! -e "$prefix/lib/libprecice.so" ]; then
  precice=${PRECICE_SOURCE:-$(fetched precice v3.4.1)}
  # with MPI, which the tube's acceleration IQN-IMVJ needs
  cmake -S "$precice" -B "$prefix/build" -DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=OFF \
    -DPRECICE_FEATURE_PETSC_MAPPING=OFF -DPRECICE_FEATURE_PYTHON_ACTIONS=OFF -DCMAKE_INSTALL_PREFIX="$prefix" -DCMAKE_INSTALL_LIBDIR=lib
  cmake --build "$prefix/build" --target install -j "$(nproc)"
fi

flags=(-std=c++14 -m64 -DOPENFOAM=1912 -DWM_DP -DWM_LABEL_SIZE=32 -DNoRepository -O2 -fPIC -ftemplate-depth-100 -w
  -DADAPTER_ENABLE_TIMINGS= -I"$prefix/include" -isystem "$source/src/transportModels")
while read -r folder; do flags+=(-I"$folder"); done < <(find "$adapter" -name '*.H' -printf '%h\n' | sort -u)
for part in OpenFOAM OSspecific/POSIX finiteVolume meshTools fileFormats surfMesh "${parts[@]}"; do
  flags+=(-isystem "$source/src/$part/lnInclude")
done
mkdir -p "$prefix"/objects/{CHT,FSI,FF}
grep -o '^[^ #]*\.C' "$adapter/Make/files" | xargs -P "$(nproc)" -I FILE g++ "${flags[@]}" -c "$adapter/FILE" -o "$prefix/objects/FILE.o"
g++ -shared "$prefix"/objects/*.o "$prefix"/objects/*/*.o -o "$prefix/lib/libpreciceAdapterFunctionObject.so" -Wl,--no-as-needed \
  -lfiniteVolume -lmeshTools -lcompressibleTurbulenceModels -lincompressibleTurbulenceModels -limmiscibleIncompressibleTwoPhaseMixture \
  -L"$prefix/lib" -lprecice
echo "$prefix"

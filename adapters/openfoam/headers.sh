#!/usr/bin/env bash
# Prints the folder whose src/ has OpenFOAM's headers: OPENFOAM_SOURCE, or those of Debian's OpenFOAM.
#
#     ./headers.sh [PART…]     further parts of src/ than this adapter needs
#
# Debian's package has none: they are taken from its source package (55 MB through apt with an apt configuration of its
# own; no root needed), and kept in ~/.cache/mesh-motion (50 MB).
# Exit status 69: there is no OpenFOAM here, or no way to its headers.
set -euo pipefail

unavailable() {
  echo "$1" >&2
  exit 69
}

PARTS="OpenFOAM OSspecific/POSIX finiteVolume dynamicMesh meshTools fileFormats surfMesh fvMotionSolver $*"

has_headers() { for part in $PARTS; do [ -d "$1/src/$part/lnInclude" ] || return 1; done; }

# The source package of the installed version, into the folder $1.
fetch_headers() {
  local to=$1 scratch version site release keyring=/usr/share/keyrings/debian-archive-keyring.gpg
  version=$(dpkg-query -W -f '${source:Version}' libopenfoam)
  command -v apt-get >/dev/null || unavailable "the headers of OpenFOAM are missing, and there is no apt-get"
  scratch=$(mktemp -d)
  trap 'rm -rf "$scratch"' RETURN
  mkdir -p "$scratch/lists/partial" "$scratch/tree" "$to"
  # where the binary package came from, or where Debian usually is
  read -r site release < <(apt-cache policy libopenfoam | awk '/http/ { split($3, s, "/"); print $2, s[1]; exit }') || true
  site=${site:-http://deb.debian.org/debian}
  release=${release:-$(. /etc/os-release && echo "$VERSION_CODENAME")}
  echo "deb-src [signed-by=$keyring] $site $release main" >"$scratch/sources.list"
  local options=(-qq -o "Dir::Etc::SourceList=$scratch/sources.list" -o Dir::Etc::SourceParts=-
    -o "Dir::State::Lists=$scratch/lists" -o "Dir::Cache=$scratch" -o "APT::Sandbox::User=$(id -un)")
  echo "fetching the headers of OpenFOAM: Debian's source package, 55 MB" >&2
  apt-get "${options[@]}" update >&2 &&
    (cd "$scratch" && apt-get "${options[@]}" source --download-only "openfoam=$version" >&2) ||
    unavailable "the source package openfoam $version cannot be had from $site: set OPENFOAM_SOURCE"
  local wanted=('*/wmake/*')
  for part in $PARTS; do wanted+=("*/src/$part/*"); done
  tar -xjf "$scratch"/openfoam_*.orig.tar.bz2 -C "$scratch/tree" --strip-components=1 --wildcards "${wanted[@]}"
  (cd "$scratch/tree/src" && for makes in $(find $PARTS -name Make -type d); do
    sh ../wmake/wmakeLnInclude -silent "$(dirname "$makes")" >/dev/null 2>&1
  done)
  rm -rf "$to/src"
  mv "$scratch/tree/src" "$to/src"
}

if [ -n "${OPENFOAM_SOURCE:-}" ]; then
  has_headers "$OPENFOAM_SOURCE" || unavailable "$OPENFOAM_SOURCE has no lnInclude folders: run wmakeLnInclude there"
  echo "$OPENFOAM_SOURCE"
  exit
fi
command -v moveDynamicMesh >/dev/null || unavailable "OpenFOAM is not installed (Debian: apt-get install openfoam)"
dpkg-query -W libopenfoam >/dev/null 2>&1 || unavailable "set OPENFOAM_SOURCE to the sources of this OpenFOAM"
source=${XDG_CACHE_HOME:-$HOME/.cache}/mesh-motion/openfoam-$(dpkg-query -W -f '${source:Version}' libopenfoam)
has_headers "$source" || fetch_headers "$source"
echo "$source"

#!/bin/sh
# Runs a command as on a machine without a compiler: `tools/without_compiler.sh make demo VENV=out/bare/venv`.
# Its PATH is a folder of links to all programs of the present PATH except compilers.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
for directory in $(echo "$PATH" | tr : ' '); do
  for program in "$directory"/*; do
    name=${program##*/}
    case $name in
      cc | c++ | c[89]9 | *gcc* | *g++* | *clang* | *gfortran* | zig | as | ld | ld.* | *-ld | *-as) ;;
      *) [ -x "$program" ] && [ ! -e "$folder/$name" ] && ln -s "$program" "$folder/$name" ;;
    esac
  done
done
# Make's interpreter by its own place: an environment made through a link would end with the link.
PYTHON=$(python3 -c 'import sys; print(sys.executable)')
export PYTHON
SKBUILD_BUILD_DIR=out/without-compiler env -u CC -u CXX PATH="$folder" "$@"

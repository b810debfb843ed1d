#!/bin/sh
# Runs a command as on a machine without a compiler: `tools/without_compiler.sh make demo VENV=out/bare/venv`.
# Its PATH is a folder of links to all programs of this one's PATH but compilers.
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
# pyenv and the like look at their own name: the interpreter itself
ln -sf "$(python3 -c 'import sys; print(sys.executable)')" "$folder/python3"
SKBUILD_BUILD_DIR=out/without-compiler env -u CC -u CXX PATH="$folder" "$@"

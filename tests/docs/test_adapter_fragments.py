"""Program and file fragments on the adapters' pages compile, or can be read, unchanged.

The fragments of adapters/c/README.md and adapters/precice/README.md.
"""

import re
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from mesh_motion_precice import read_configuration
from programs import need

ROOT = Path(__file__).parents[2]
ADAPTER = ROOT / "adapters" / "c"
PAGE = (ADAPTER / "README.md").read_text(encoding="utf-8")

#: The text around a fragment: the declarations that the page's words imply; {} is the fragment's place.
AROUND = {
    "c": """
        #include <mesh_motion.h>
        #include <stdio.h>
        #include <string.h>
        enum {{ MPI_CHAR, MPI_BYTE, MPI_COMM_WORLD }};
        void MPI_Bcast(void *, size_t, int, int, int);
        void run(mm_session *session, int rank, int ranks, size_t nodes, double *points, size_t quad_count,
                 int64_t *quads, size_t block_count, int64_t *block, size_t wall_count, int64_t *walls, size_t moving,
                 double *rows, double *displacement, int64_t *numbers, size_t cells, int64_t *tetrahedra,
                 size_t wing_count, int64_t *wing)
        {{ {} }}
        """,
    "cpp": """
        #include <mesh_motion.hpp>
        void run(std::vector<double> points, std::vector<std::int64_t> quads, std::vector<std::int64_t> block,
                 std::vector<double> rows, std::vector<double> displacement)
        {{ {} }}
        """,
    "fortran": """
subroutine run(points, quads, block, rows, displacement)
{}
double precision :: points(:, :), rows(:, :), displacement(:, :)
integer :: quads(:, :), block(:)
{}
end subroutine
        """,
}
COMPILERS = {"c": ["gcc", "-std=c11"], "cpp": ["g++", "-std=c++17"], "fortran": ["gfortran", "-std=f2008"]}
ENDINGS = {"c": "c", "cpp": "cpp", "fortran": "f90"}


def fragments() -> list[tuple[str, str]]:
    return re.findall(r"```(c|cpp|fortran)\n(.*?)```", PAGE, re.DOTALL)


def program(language: str, fragment: str) -> str:
    """A fragment with the code that it needs before and after it."""
    if language == "fortran":
        lines = fragment.splitlines()
        first = next(i for i, line in enumerate(lines) if not line.startswith(("use", "type")))
        return AROUND[language].format("\n".join(lines[:first]), "\n".join(lines[first:]))
    if "mm_session *session" in fragment:
        return AROUND[language].replace("mm_session *session, ", "").format(fragment)
    return AROUND[language].format(fragment)


def compiled(language: str, text: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """The compiler's messages about syntax and types."""
    compiler = COMPILERS[language]
    need(compiler[0])
    if language == "fortran":
        module = [*compiler, "-fsyntax-only", f"-J{folder}", ADAPTER / "fortran" / "mesh_motion.f90"]
        subprocess.run(module, check=True)
    source = folder / f"fragment.{ENDINGS[language]}"
    source.write_text(text, encoding="utf-8")
    command = [*compiler, "-fsyntax-only", "-Werror", "-I", ADAPTER / "include", "-I", folder, source]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(("language", "fragment"), fragments(), ids=lambda text: text.splitlines()[0][:30])
def test_a_fragment_compiles(language: str, fragment: str, tmp_path: Path) -> None:
    done = compiled(language, program(language, fragment), tmp_path)
    assert done.returncode == 0, done.stderr


def test_the_file_of_the_precice_participant_is_one(tmp_path: Path) -> None:
    page = (ROOT / "adapters" / "precice" / "README.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    (tmp_path / "mesh-motion.toml").write_text(block, encoding="utf-8")
    found = read_configuration(tmp_path / "mesh-motion.toml")
    assert [surface.patch for surface in found.surfaces] == ["flap"]
    (other,) = re.findall(r"```json\n(.*?)```", page, re.DOTALL)
    (tmp_path / "precice-adapter-config.json").write_text(other, encoding="utf-8")
    kept = ("[mesh]", "[patches]", "[method]")
    tables = [part for part in re.split(r"^(?=\[)", block, flags=re.MULTILINE) if part.startswith(kept)]
    (tmp_path / "mesh-motion.toml").write_text("".join(tables), encoding="utf-8")
    same = read_configuration(tmp_path / "precice-adapter-config.json")
    assert replace(same, volume=replace(same.volume, velocity="")) == found

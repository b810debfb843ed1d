"""The installed C client: a CMake package, a pkg-config file, a plain Makefile; it exports only ``mm_`` names.

As docs/tutorials/own_code_in_c.md installs it.
"""

import os
import re
from pathlib import Path

import pytest

CONSUMER = """
#include <mesh_motion.h>
#include <stdio.h>
int main(void)
{
    mm_context *server = mm_context_new();
    mm_connect(server, "nowhere");
    printf("%d %s\\n", (int)mm_error(server), mm_error_code(server));
    mm_context_free(server);
    return 0;
}
"""
CPP_CONSUMER = """
#include <mesh_motion.hpp>
#include <cstdio>
int main()
{
    try {
        mesh_motion::Server("nowhere");
    } catch (const mesh_motion::Error &error) {
        std::printf("%d %s\\n", error.result(), error.code().c_str());
    }
}
"""
#: The arrays of a mesh are not copied: those that end with the statement are refused by the compiler.
TEMPORARIES = """
#include <mesh_motion.hpp>
using mesh_motion::Session;
template <class Given, class = void>
struct taken : std::false_type {};
template <class Given>
struct taken<Given, std::void_t<decltype(std::declval<Session &>().points(2, std::declval<Given>()))>>
    : std::true_type {};
static_assert(taken<std::vector<double> &>::value);
static_assert(taken<const std::vector<double> &>::value);
static_assert(taken<mesh_motion::View<const double>>::value);
static_assert(!taken<std::vector<double>>::value);
void of_a_pointer(Session &session, const double *points, std::vector<std::int64_t> &nodes)
{
    session.points(2, {points, 3}).patch("all", "moving", {nodes.data(), 2}).cells("quad", nodes);
}
"""
FORTRAN_CONSUMER = """
program consumer
   use mesh_motion
   type(mm_server) :: server
   call server%connect("nowhere")
   if (server%failed()) print "(a)", "3 "//server%error_code()
   call server%free()
end program
"""
ANSWER = "3 INVALID_ARGUMENT\n"
PROJECT = """
cmake_minimum_required(VERSION 3.16)
project(consumer LANGUAGES {language})
find_package(mesh_motion 1.0 REQUIRED)
add_executable(consumer {source})
target_link_libraries(consumer PRIVATE mesh_motion::{target})
"""


@pytest.fixture
def consumer(tmp_path):
    """The folder of a program that uses the library, with a blank in its name."""
    folder = tmp_path / "my code"
    folder.mkdir()
    (folder / "consumer.c").write_text(CONSUMER)
    return folder


@pytest.fixture(scope="module")
def packaged(tmp_path_factory, tools, zmq_flags):
    """The prefix in a package of Debian: CMake has installed for /usr, below a folder, for one architecture."""
    tools["need"]("cmake", "gcc")
    folder = tmp_path_factory.mktemp("packaged")
    places = ["-DCMAKE_INSTALL_PREFIX=/usr", "-DCMAKE_INSTALL_LIBDIR=lib/x86_64-linux-gnu"]
    tools["compile"](["cmake", "-S", tools["source"], "-B", folder / "build", *places])
    tools["compile"](["cmake", "--build", folder / "build"])
    tools["run"](["cmake", "--install", folder / "build"], env=os.environ | {"DESTDIR": str(folder / "package")})
    return folder / "package" / "usr"


@pytest.fixture(scope="module")
def made(tmp_path_factory, tools, zmq_flags):
    """The prefix that the Makefile has installed into."""
    tools["need"]("make", "gcc")
    folder = tmp_path_factory.mktemp("make")
    paths = [f"OUT={folder}/out", f"PREFIX={folder}/prefix"]
    tools["compile"](["make", "-C", tools["source"], "install", *paths, "CFLAGS=-O1 -Werror"])
    return folder / "prefix"


@pytest.mark.parametrize(
    ("language", "needed", "source", "text", "target"),
    [
        ("C", "gcc", "consumer.c", CONSUMER, "mesh_motion"),
        ("CXX", "g++", "consumer.cpp", CPP_CONSUMER, "mesh_motion"),
        ("Fortran", "gfortran", "consumer.f90", FORTRAN_CONSUMER, "mesh_motion_fortran"),
    ],
)
def test_find_package(installed, consumer, tools, language, needed, source, text, target):
    tools["need"](needed)
    (consumer / source).write_text(text)
    (consumer / "CMakeLists.txt").write_text(PROJECT.format(language=language, source=source, target=target))
    tools["compile"](["cmake", "-S", consumer, "-B", consumer / "build", f"-DCMAKE_PREFIX_PATH={installed}"])
    tools["compile"](["cmake", "--build", consumer / "build"])
    assert tools["run"]([consumer / "build" / "consumer"]) == ANSWER


def test_temporaries_are_no_arrays_of_a_mesh(tools, tmp_path):
    tools["need"]("g++")
    (tmp_path / "temporaries.cpp").write_text(TEMPORARIES)
    flags = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", f"-I{tools['source'] / 'include'}"]
    tools["compile"](["g++", *flags, tmp_path / "temporaries.cpp"])


@pytest.mark.parametrize(
    ("prefix", "folder"), [("installed", "lib"), ("made", "lib"), ("packaged", "lib/x86_64-linux-gnu")]
)
def test_pkg_config(prefix, folder, consumer, tools, request):
    prefix = request.getfixturevalue(prefix)
    environment = os.environ | {"PKG_CONFIG_PATH": str(prefix / folder / "pkgconfig")}
    known = tools["run"](["pkg-config", "--variable=prefix", "mesh_motion"], env=environment)
    assert Path(known.strip()).resolve() == prefix
    flags = tools["run"](["pkg-config", "--cflags", "--libs", "mesh_motion"], env=environment).split()
    tools["compile"](["gcc", consumer / "consumer.c", *flags, "-o", consumer / "consumer"])
    assert tools["run"]([consumer / "consumer"], env=os.environ | {"LD_LIBRARY_PATH": str(prefix / folder)}) == ANSWER
    licence = (tools["source"].parents[1] / "LICENSE").read_text()
    assert (prefix / "share" / "doc" / "mesh_motion" / "LICENSE").read_text() == licence


def test_a_static_library(made, consumer, tools, zmq_flags):
    archive = made / "lib" / "libmesh_motion.a"
    include = f"-I{made}/include"
    tools["compile"](["gcc", consumer / "consumer.c", include, archive, *zmq_flags, "-lm", "-o", consumer / "consumer"])
    assert tools["run"]([consumer / "consumer"]) == ANSWER


@pytest.mark.parametrize("prefix", ["installed", "made"])
def test_the_library_exports_exactly_the_declared_functions(prefix, tools, request):
    library = request.getfixturevalue(prefix) / "lib" / "libmesh_motion.so"
    names = set(re.findall(r" T (\w+)", tools["run"](["nm", "-D", "--defined-only", library])))
    declared = set(
        re.findall(r"MM_API [^;]*?\b(mm_\w+)\(", (tools["source"] / "include" / "mesh_motion.h").read_text())
    )
    assert names == declared
    assert re.search(r"SONAME\s+libmesh_motion\.so\.1\n", tools["run"](["objdump", "-p", library]))


def test_there_is_no_global_state(compiler, tools):
    """All variable data belongs to contexts and sessions: the sections of written data are empty."""
    for source in tools["client"]:
        made = compiler.folder / f"plain_{source.stem}.o"
        flags = ["-std=c11", f"-I{tools['source'] / 'include'}", *compiler.zmq_flags]
        tools["compile"](["gcc", *flags, "-c", source, "-o", made])
        sections = re.findall(r"\s\.(data|bss)\s+([0-9a-f]+)", tools["run"](["objdump", "-h", made]))
        assert {(name, int(size, 16)) for name, size in sections} == {("data", 0), ("bss", 0)}


def test_private_names_have_a_prefix(made, tools):
    """The sources can be compiled into a program with any names; only a library with the kernels has mmv_ names."""
    listed = tools["run"](["nm", "--defined-only", "--extern-only", made / "lib" / "libmesh_motion.a"])
    names = set(re.findall(r" [A-Z] (\w+)", listed))
    assert {name for name in names if not name.startswith(("mm_", "mmi_", "mmv_"))} == set()


@pytest.mark.parametrize("build", ["adapters/c/CMakeLists.txt", "adapters/openfoam/Make/files"])
def test_each_build_has_all_sources(build, tools):
    listed = re.findall(r"src/(mm_\w+\.c)\b", (tools["root"] / build).read_text())
    assert listed == [source.name for source in tools["client"]]

"""Each layer may import only layers to its left: the rule of the house, checked on the source."""

import ast
import re
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = {
    "mesh_motion_numerics": ROOT / "numerics" / "mesh_motion_numerics",
    "mesh_motion_server": ROOT / "mesh_motion_server",
    "mesh_motion_protocol": ROOT / "adapters" / "python" / "mesh_motion_protocol",
    "mesh_motion_conformance": ROOT / "protocol" / "conformance" / "mesh_motion_conformance",
    "mesh_motion_client": ROOT / "adapters" / "python" / "mesh_motion_client",
    "mesh_motion_calculix": ROOT / "adapters" / "calculix" / "mesh_motion_calculix",
    "mesh_motion_kratos": ROOT / "adapters" / "kratos" / "mesh_motion_kratos",
    "mesh_motion_fsi": ROOT / "adapters" / "fsi" / "mesh_motion_fsi",
    "mesh_motion_openmdao": ROOT / "adapters" / "openmdao" / "mesh_motion_openmdao",
    "mesh_motion_precice": ROOT / "adapters" / "precice" / "mesh_motion_precice",
}
#: The rooms of numerics: each may import those before it.
ROOMS = ["mesh", "interpolation", "quality", "correction", "reduction", "motion", "distributed"]
#: The rooms of session: each may import those before it, and no module above them.
SESSION_ROOMS = ["partitions", "journal", "history"]
LAYERS = ["session", "service", "transport"]
ENGINE = ("dask", "distributed")
#: Folders of the checkout that are in no wheel.
APART_FROM_ALL = ("benchmarks", "docs", "tools", "tests")
#: Packages that work without the server, and the other packages that they may not import.
APART = {
    "mesh_motion_protocol": ("zmq", "mesh_motion_client", "mesh_motion_conformance"),
    "mesh_motion_conformance": ("mesh_motion_protocol", "mesh_motion_client"),
    "mesh_motion_client": (),
    "mesh_motion_calculix": ("zmq", "msgpack", "mesh_motion_protocol", "mesh_motion_client"),
    "mesh_motion_openmdao": ("zmq", "msgpack", "mesh_motion_protocol"),
    "mesh_motion_fsi": ("msgpack", "mesh_motion_protocol", "mesh_motion_client", "mesh_motion_calculix"),
}
#: It looks at folders alone: nothing is asked of a running server.
OBSERVATION = (
    "zmq",
    "mesh_motion_client",
    *(f"mesh_motion_server.{part}" for part in ("service", "transport", "cases")),
)
HEAVY = ("scipy", "mesh_motion_kernels", "pydantic", "mesh_motion_numerics", "mesh_motion_server")
#: Exceptions: what a module of the client loads where a caller needs it, and the errors that all packages share.
ALLOWED = {
    "mesh_motion_client.volume": "mesh_motion_numerics.distributed",
    "mesh_motion_numerics": "mesh_motion_protocol.errors",
}


def forbidden(module: str) -> tuple[str, ...]:
    package, *inner = module.split(".")
    if package == "mesh_motion_precice":  # of the server it takes how text is shown; scipy's k-d tree
        above = (*LAYERS, "cases", "commands", "files")
        return (*HEAVY[1:-1], "zmq", *(f"mesh_motion_server.{part}" for part in above))
    if package in APART:
        return (*HEAVY, *APART[package])
    if package == "mesh_motion_numerics":
        rooms = ROOMS[ROOMS.index(inner[0]) + 1 :] if inner and inner[0] in ROOMS else ROOMS
        above = [f"{package}.{room}" for room in rooms]
        around = ("mesh_motion_client", "mesh_motion_server", "mesh_motion_protocol", *ENGINE, *APART_FROM_ALL)
        return (*above, *around, "zmq", "msgpack", "pydantic", "logging")
    if not inner or inner[0] not in (*LAYERS, "files"):
        return (*OBSERVATION, *APART_FROM_ALL) if inner[:2] == ["watch", "observation"] else APART_FROM_ALL
    if inner[0] == "files":
        return tuple(f"{package}.{layer}" for layer in LAYERS[1:])
    above = [f"{package}.{layer}" for layer in LAYERS[LAYERS.index(inner[0]) + 1 :]]
    around = [
        f"{package}.files",
        f"{package}.cases",
        f"{package}.commands",
        *ENGINE,
        "mesh_motion_client",
        *APART_FROM_ALL,
    ]
    if inner[0] == "session" and inner[1] in SESSION_ROOMS:
        above += session_above(inner[1])
    return (*above, *around) if inner[0] == "transport" else (*above, *around, "zmq")


def session_above(room: str) -> list[str]:
    """Modules that a room of the session may not import: later rooms and the modules outside the rooms."""
    folder = PACKAGES["mesh_motion_server"] / "session"
    around = [path.stem for path in folder.glob("*.py") if path.stem != "__init__"]
    later = SESSION_ROOMS[SESSION_ROOMS.index(room) + 1 :]
    return [f"mesh_motion_server.session.{name}" for name in (*later, *around)]


def imported(module: str, tree: ast.AST) -> list[str]:
    names: list[str] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = module.split(".")[: -node.level] if node.level else []
            base += [node.module] if node.module else []
            names += [".".join((*base, alias.name)) for alias in node.names]
    return names


def offences(module: str, source: str) -> list[str]:
    names = imported(module, ast.parse(source))
    allowed = ALLOWED.get(module) or ALLOWED.get(module.split(".", maxsplit=1)[0], "none")
    names = [name for name in names if not within(name, allowed)]
    return [name for name in names for bad in forbidden(module) if within(name, bad)]


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(package + ".")


MODULES = [
    (".".join((package, *path.relative_to(folder).with_suffix("").parts)), path)
    for package, folder in PACKAGES.items()
    for path in sorted(folder.rglob("*.py"))
]


def test_imports_point_to_the_left() -> None:
    found = {module: offences(module, path.read_text()) for module, path in MODULES}
    assert {module: offending for module, offending in found.items() if offending} == {}


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("mesh_motion_numerics.seeded", "from mesh_motion_server.session import state"),
        ("mesh_motion_numerics.seeded", "def f():\n    import zmq"),
        ("mesh_motion_numerics.mesh.seeded", "from mesh_motion_numerics.quality import metrics"),
        ("mesh_motion_numerics.seeded", "from mesh_motion_numerics.mesh import cells"),
        ("mesh_motion_server.session.seeded", "from tests.faults import wire"),
        ("mesh_motion_server.session.journal.seeded", "from mesh_motion_server.session.state import State"),
        ("mesh_motion_server.session.partitions.seeded", "from mesh_motion_server.session.journal import records"),
        ("mesh_motion_numerics.motion.seeded", "from mesh_motion_numerics.distributed import rank"),
        ("mesh_motion_numerics.seeded", "from mesh_motion_protocol.messages import Move"),
        ("mesh_motion_numerics.distributed.seeded", "from mesh_motion_server.session import state"),
        ("mesh_motion_server.session.seeded", "def f():\n    from distributed import Client"),
        ("mesh_motion_server.service.seeded", "from ..transport import gateway"),
        ("mesh_motion_server.watch.observation.seeded", "from ...transport import gateway"),
        ("mesh_motion_protocol.seeded", "from scipy.spatial import cKDTree"),
        ("mesh_motion_conformance.seeded", "from mesh_motion_protocol.codec import decode"),
        ("mesh_motion_client.seeded", "import mesh_motion_server"),
        ("mesh_motion_client.volume", "from mesh_motion_server.session import state"),
        ("mesh_motion_client.exchange", "from mesh_motion_server.files import read_mesh"),
        ("mesh_motion_precice.seeded", "from mesh_motion_numerics import motion"),
    ],
)
def test_the_walk_sees_a_seeded_offence(module: str, source: str) -> None:
    assert offences(module, source)


def running(node: ast.AST) -> ast.AST:
    """The tree without the imports that only type checkers read."""
    for inner in ast.walk(node):
        if isinstance(inner, ast.If) and ast.unparse(inner.test) == "TYPE_CHECKING":
            inner.body = []
    return node


def imports_of(sources: dict[str, str]) -> dict[str, set[str]]:
    """Module → the modules that it imports at run time."""
    graph = {}
    for module, source in sources.items():
        names = imported(module, running(ast.parse(source)))
        graph[module] = {n if n in sources else n.rpartition(".")[0] for n in names} & sources.keys() - {module}
    return graph


def calls_of(sources: dict[str, str]) -> dict[str, set[str]]:
    """C file → the files whose functions it names."""
    code = {name: re.sub(r'/\*.*?\*/|"(\\.|[^"\\])*"', "", text, flags=re.DOTALL) for name, text in sources.items()}
    defined = r"^(?!static|#)\w[\w *]*?\b(mmi?v?_\w+)\([^;{]*\)\s*\{"
    home = {function: name for name, text in code.items() for function in re.findall(defined, text, re.MULTILINE)}
    return {name: {home.get(word, name) for word in re.findall(r"\w+", text)} - {name} for name, text in code.items()}


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Modules that need each other in a circle, in order; empty if there are none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_no_modules_import_each_other_in_a_circle() -> None:
    assert circle(imports_of({module: path.read_text() for module, path in MODULES})) == []


def test_the_walk_sees_a_seeded_circle() -> None:
    types_only = "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from a.x import X"
    assert circle(imports_of({"a.x": "from a import y", "a.y": types_only})) == []
    assert len(circle(imports_of({"a.x": "from a import y", "a.y": "def f():\n    from a.x import X"}))) == 3


def test_no_files_of_the_c_client_call_each_other_in_a_circle() -> None:
    sources = {path.stem: path.read_text() for path in (ROOT / "adapters" / "c" / "src").glob("*.c")}
    graph = calls_of(sources)
    assert circle(graph) == []
    assert all(graph[name] for name in sources.keys() - {"mm_wire", "mm_volume"}), "some calls are not seen"
    seeded = sources["mm_error"] + "\nvoid mmi_seeded(connection *c) { mmi_disconnect(c); }\n"
    assert set(circle(calls_of(sources | {"mm_error": seeded}))) == {"mm_error", "mm_connection"}


#: Modules that start before any worker: the command, the supervisor with its store, the gateway and the attendants.
STARTERS = (
    "mesh_motion_server.commands.cli",
    "mesh_motion_server.transport.serve",
    "mesh_motion_server.transport.gateway",
    "mesh_motion_server.transport.monitor",
    "mesh_motion_server.transport.authenticator",
    "mesh_motion_server.session.store",
)


@pytest.mark.parametrize("module", STARTERS)
def test_a_server_is_up_before_scipy_is_loaded(module: str) -> None:
    """SciPy takes a third of a second and 40 MB, and only workers need it."""
    script = f"import sys, {module}; print('scipy' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout == "False\n"

"""The table of the commands of ``mesh-motion``.

Each command imports its modules only when it runs, so that ``--help`` is quick.
"""

from __future__ import annotations

import platform
from typing import Annotated

import typer

from mesh_motion_server import __version__
from mesh_motion_server.commands.check import check
from mesh_motion_server.commands.conform import conform
from mesh_motion_server.commands.convert import convert
from mesh_motion_server.commands.demo import demo
from mesh_motion_server.commands.init import init
from mesh_motion_server.commands.inspect import inspect
from mesh_motion_server.commands.keys import keys as keys_app
from mesh_motion_server.commands.outcome import say
from mesh_motion_server.commands.play import play
from mesh_motion_server.commands.plot import plot
from mesh_motion_server.commands.serve import serve

_EPILOGUE = (
    "Exit status: 0 done; 1 a requirement is not met (conform), or the replayed states differ (play --from-journal); "
    "2 wrong usage or invalid input; 3 refused, because no acceptable mesh was found; 4 a session, a limit or the "
    "storage does not allow it; 69 no answer, or a package is not installed; 70 a defect of this program; 78 wrong or "
    "unsafe server settings; 130 interrupted."
)

app = typer.Typer(
    name="mesh-motion",
    help="Move volume meshes with their boundaries: predict the quality, correct the motion, then move.",
    epilog=_EPILOGUE,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
app.command(short_help="Write a case file for a mesh.")(init)
app.command(short_help="Check a case or a mesh file.")(check)
app.command(short_help="Move a mesh as a case describes, or replay a session.")(play)
app.command(short_help="Run the server until SIGTERM.")(serve)
app.command(short_help="Show sessions, verify stored ones, or follow them.")(inspect)
app.command(short_help="Draw runs and meshes for a paper.")(plot)
app.command(short_help="Write a mesh in another format.")(convert)
app.command(short_help="Check a server or a client against SPEC.md.")(conform)
app.command(short_help="Play the thesis' cases and a flag.")(demo)
app.add_typer(keys_app, name="keys", short_help="Make keys, and admit clients to a server.")


def _print_version(asked: bool) -> None:
    if asked:
        say(f"mesh-motion-server {__version__}, protocol 1.0")
        raise typer.Exit


@app.callback()
def _program(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


@app.command(short_help="Print versions.")
def version() -> None:
    """Print the versions of the program, of its protocol and of the libraries that compute.

    \b
    mesh-motion version
    """
    from importlib.metadata import PackageNotFoundError  # noqa: PLC0415
    from importlib.metadata import version as installed  # noqa: PLC0415

    packages = []
    for name in ("numpy", "scipy", "pyzmq"):
        try:
            packages.append(f"{name} {installed(name)}")
        except PackageNotFoundError:
            packages.append(f"{name} not installed")
    say(f"mesh-motion-server {__version__}, protocol 1.0")
    say(f"Python {platform.python_version()}, {', '.join(packages)}")

"""Program of the template if the numerics cannot be imported."""

from importlib import import_module

from mesh_motion_server.transport import template


def main(channel, level):
    return template.main(channel, level, lambda: import_module("not_installed"))

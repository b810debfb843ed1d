"""The Host header of an HTTP request: it refuses pages of other sites whose name resolves to this machine."""

import ipaddress


def is_allowed_host(host: str, *, insecure: bool) -> bool:
    """Whether a Host header names this server, independent of any name service.

    Parameters
    ----------
    host : str
        NAME, NAME:PORT or [ADDRESS]:PORT; with a tunnel the port is that of its near end.
    insecure : bool
        Whether addresses outside the loopback are accepted, too.
    """
    name, separator, port = host.rpartition(":")
    if not separator or host.endswith("]"):
        name, port = host, "0"
    if not (port.isascii() and port.isdigit()):
        return False
    if name.lower() == "localhost":
        return True
    try:
        bracketed = name.startswith("[") and name.endswith("]")
        address = ipaddress.ip_address(name[1:-1] if bracketed else name)
    except ValueError:
        return False
    return (address.version == 6) == bracketed and (insecure or address.is_loopback)

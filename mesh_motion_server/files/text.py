"""The text of files of other programs."""

__all__ = ["text_of"]


def text_of(data: bytes) -> str:
    """UTF-8; lines that are not are in the Western alphabet of Windows: two names never become one."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        lines = data.splitlines(keepends=True)
    if len(lines) == 1:
        return data.decode("cp1252", errors="backslashreplace")
    return "".join(map(text_of, lines))

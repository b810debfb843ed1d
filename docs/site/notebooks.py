"""Notebooks as pages: their cells and the stored outputs, as Markdown. Only a test runs the notebooks."""

from __future__ import annotations

from typing import Any

__all__ = ["markdown_of"]


def markdown_of(notebook: dict[str, Any]) -> str:
    """The cells one after the other."""
    return "\n\n".join(part for cell in notebook["cells"] for part in _parts(cell)) + "\n"


def _parts(cell: dict[str, Any]) -> list[str]:
    source = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        return [source]
    streamed = "".join("".join(output.get("text", "")) for output in cell["outputs"])
    printed = [f"```text\n{streamed.rpartition(chr(13))[2].rstrip()}\n```"] if streamed else []
    return [f"```python\n{source}\n```", *printed, *(_output(one["data"]) for one in cell["outputs"] if "data" in one)]


def _output(data: dict[str, Any]) -> str:
    """Output of a cell: a picture, markup, or text."""
    if "image/png" in data:
        picture = "".join(data["image/png"]).replace("\n", "")
        return f'```{{raw}} html\n<img alt="the picture" src="data:image/png;base64,{picture}">\n```'
    if "text/html" in data:
        return "```{raw} html\n" + "".join(data["text/html"]) + "\n```"
    return "```text\n" + "".join(data["text/plain"]) + "\n```"

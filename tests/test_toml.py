"""Text that should be TOML: keys of very many parts are refused at once, all normal text is read."""

import time
import tomllib
from typing import Any

import pytest

from mesh_motion_server.toml import read_toml

MANY = 30_000


@pytest.mark.parametrize("part", ["a", "a-1", '"a b"', "'a'"])
@pytest.mark.parametrize("dot", [".", " .\t"])
@pytest.mark.parametrize("place", ["{} = 1", "[{}]", "[[{}]]", "x = {{ y = 2, {} = 1 }}"])
def test_a_key_of_very_many_parts_is_refused(part: str, dot: str, place: str) -> None:
    with pytest.raises(tomllib.TOMLDecodeError, match=r"more than 100 dotted parts \(at line 3\)"):
        read_toml("\n\n" + place.format(dot.join([part] * MANY)))


def nested(parts: int) -> dict[str, Any]:
    return {"a": nested(parts - 1)} if parts else {"b": 1}


def test_usual_files_are_read() -> None:
    floats = ", ".join(["0.5", "-1.25e-3"] * 500)
    names = ", ".join(['"x.y"'] * 500)
    text = f"a = [{floats}]\nb = 'mesh.v1.2.msh ... and so on.'\nc = [{names}]"
    assert read_toml(text) == tomllib.loads(text)
    assert read_toml(".".join("a" * 99) + ".b = 1") == nested(99)


@pytest.mark.parametrize("piece", ["a", '"', "'", "a.", " ", "a. ", '"a".', "[", '"a', "a.b c."])
def test_a_large_text_is_refused_soon(piece: str) -> None:
    began = time.process_time()
    with pytest.raises(tomllib.TOMLDecodeError):
        read_toml("a = " + piece * 100_000)
    assert time.process_time() - began < 2.0


@pytest.mark.parametrize(
    "text", ["[" * 100_000, "[" * 50_000 + "]" * 50_000, "{a = " * 100_000, "[\n1, {a = " * 50_000]
)
def test_the_line_of_values_that_are_nested_too_deep_is_named(text: str) -> None:
    with pytest.raises(tomllib.TOMLDecodeError, match=r"^values nested too deep to be read \(at line 3\)$"):
        read_toml(f"b = [[1]]\n\na = {text}")


@pytest.mark.parametrize("digits", ["9" * 400, "9" * 5000, "0x" + "f" * 5000, str(2**63), str(-(2**63) - 1)])
@pytest.mark.parametrize("place", ["{}", "[1, {}]", "[[{{ a = {} }}]]"])
def test_an_integer_that_fits_into_no_number_is_refused(digits: str, place: str) -> None:
    with pytest.raises(tomllib.TOMLDecodeError, match="an integer of more than 64 bits"):
        read_toml("a = " + place.format(digits))
    assert read_toml(f"a = [{2**63 - 1}, {-(2**63)}]") == {"a": [2**63 - 1, -(2**63)]}

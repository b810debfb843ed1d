"""The C client's decoder: the vectors, messages that are not a reply, and hundreds of thousands of broken frames."""

import json
import subprocess
from importlib import resources

import msgpack
import pytest
from mesh_motion_conformance.tables import tables

CHECK = "wire_check.c"


def vectors(name):
    text = resources.files("mesh_motion_protocol.vectors").joinpath(name).read_text(encoding="utf-8")
    return json.loads(text)


def replies():
    known = {row["reply"] for row in tables().requests.values()} | {"ERROR"}
    return [v for v in vectors("valid.json") if v["message"]["type"] in known]


@pytest.fixture(scope="module")
def wire_check(compiler, tools):
    return compiler.program(tools["here"] / CHECK, client=(tools["source"] / "src" / "mm_wire.c",))


def judged(program, messages):
    """The decoder's result for each message, given as lists of hexadecimal frames."""
    given = "\n".join(" ".join(frames) for frames in messages) + "\n"
    done = subprocess.run([program], input=given, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr[-3000:]
    lines = done.stdout.splitlines()
    assert len(lines) == len(messages)
    return lines


def test_every_valid_reply_is_read(wire_check):
    given = replies()
    assert {v["message"]["type"] for v in given} >= {"WELCOME", "MOVED", "COMMITTED", "ERROR", "LISTED"}
    for vector, line in zip(given, judged(wire_check, [v["frames"] for v in given]), strict=True):
        kind, fields = line.split(" ", 1)
        assert kind == vector["message"]["type"], vector["name"]
        assert isinstance(json.JSONDecoder().raw_decode(fields)[0], dict)


def test_every_invalid_vector_is_refused(wire_check):
    given = vectors("invalid.json")
    lines = judged(wire_check, [v["frames"] for v in given])
    assert [v["name"] for v, line in zip(given, lines, strict=True) if not line.startswith("WRONG")] == []


def spoiled():
    """Replies that violate section 5 or 12 in one point, with the name of that point."""
    for vector in replies():
        first, *rest = vector["frames"]
        header = msgpack.unpackb(bytes.fromhex(first))
        kind = header["type"]

        def packed(kind=kind, header=header, rest=rest, **changes):
            return [msgpack.packb(header | changes).hex(), *rest]

        for field in tables().fields(kind):
            if field.required and field.name in header["fields"]:
                less = {name: value for name, value in header["fields"].items() if name != field.name}
                yield f"{kind} without {field.name}", packed(fields=less)
            if field.name in header["fields"]:
                yield f"{kind}.{field.name} is nil", packed(fields=header["fields"] | {field.name: None})
                wrong = 1 if field.kind in ("str", "bin", "map", "array") else "1"
                yield f"{kind}.{field.name} of another type", packed(fields=header["fields"] | {field.name: wrong})
        for i, declared in enumerate(header["arrays"]):
            for changes in (
                {"dtype": "<f2"},
                {"dtype": 8},
                {"dtype": "<i8" if declared["dtype"][1] == "f" else "<f8"},
                {"shape": [*declared["shape"], 1]},
                {"shape": [-1, *declared["shape"][1:]]},
                {"shape": [declared["shape"][0] + 1, *declared["shape"][1:]]},
                {"shape": [2**62, *declared["shape"][1:]]},
                {"shape": 4},
                {"name": "force"},
                {"more": 1},
            ):
                arrays = [*header["arrays"]]
                arrays[i] = declared | changes
                yield f"{kind}.{declared['name']} {changes}", packed(arrays=arrays)
            yield f"{kind}.{declared['name']} twice", packed(arrays=[*header["arrays"], declared])
        yield f"{kind} with a frame more", [first, *rest, "00"]
        if rest:
            yield f"{kind} with a frame less", [first, *rest[:-1]]
            yield f"{kind} with a byte less", [first, *rest[:-1], rest[-1][:-2]]
        yield f"{kind} with a seventh key", packed(more=1)


def test_every_spoiled_reply_is_refused(wire_check):
    given = list(spoiled())
    assert len(given) > 250
    lines = judged(wire_check, [frames for _, frames in given])
    assert [what for (what, _), line in zip(given, lines, strict=True) if not line.startswith("WRONG")] == []


def fuzz(program, count, seed):
    given = [v["frames"] for v in replies() * 2 + vectors("invalid.json") if len(v["frames"][0]) < 4000]
    text = "\n".join(" ".join(frames) for frames in given) + "\n"
    return subprocess.run(
        [program, str(count), str(seed)], input=text, capture_output=True, text=True, check=False, timeout=120
    )


def test_mutations_touch_nothing_that_is_not_there(wire_check):
    done = fuzz(wire_check, 300_000, 1)
    assert done.returncode == 0, done.stderr[-3000:]
    assert int(done.stdout.split()[0]) > 1000  # not all of them stop at the first byte


@pytest.mark.parametrize(
    ("sound", "faulty"),
    [
        ("if (in->wrong || size > in->size - in->at)", "if (in->wrong)"),
        ("if (in->wrong || bytes > in->size - in->at)", "if (in->wrong)"),
        ("if (depth == MMI_HEADER_DEPTH)", "if (depth == 99)"),
        ("sizes[next] != chunk", "(sizes[next] ^ chunk) > 63"),
        ("first > 0xf4 || more > size - i", "first > 0xf4"),
    ],
)
def test_the_fuzz_finds_a_missing_check(compiler, tools, tmp_path, sound, faulty):
    text = (tools["source"] / "src" / "mm_wire.c").read_text()
    assert text.count(sound) >= 1
    seeded = tmp_path / "mm_wire.c"
    seeded.write_text(text.replace(sound, faulty, 1))
    program = compiler.program(tools["here"] / CHECK, client=(seeded,))
    found = any(fuzz(program, 300_000, seed).returncode != 0 for seed in range(1, 5))
    assert found, "no mutation has shown the seeded fault"

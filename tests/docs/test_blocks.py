"""Every code block of the documentation is run: here, by a separate test, or the page gives a reason."""

import re
import sys
import time
from pathlib import Path

import psutil
import pytest
from page_story import ROOT, Block, blocks_of, play, steps_of

from docs.site.index import PAGES

#: Pages whose blocks a test of its own runs or checks, where its name does not show it (docs/X.md: test_X_page.py).
ELSEWHERE = {
    "README.md": "tests/test_readme.py",
    "adapters/README.md": "tests/docs/test_adapters_page.py",
    "adapters/openmdao/README.md": "tests/adapters/openmdao/test_component.py",
    "adapters/python/README.md": "tests/packaging/test_client_distribution.py",
    "protocol/conformance/README.md": "tests/conformance",
}
#: … and of the cases in examples/: they are played.
EXAMPLES = "tests/examples/test_examples.py"


def runner_of(page: str) -> str:
    own = f"tests/docs/test_{Path(page).stem}_page.py"
    if page.startswith("docs/") and (ROOT / own).exists():
        return own
    if (ROOT / page).with_name("case.toml").exists():
        return EXAMPLES
    return ELSEWHERE.get(page, "")


BLOCKS = {
    path.relative_to(ROOT).as_posix(): blocks_of(path.read_text(encoding="utf-8"))
    for pattern in PAGES
    for path in sorted(ROOT.glob(pattern))
}
HERE = [page for page, blocks in BLOCKS.items() if steps_of(blocks) and not runner_of(page)]


#: Pages whose commands take ten seconds and more.
LONG = {
    *(
        "docs/start.md",
        "docs/files.md",
        "docs/watching.md",
        "docs/tutorials/flag.md",
        "docs/tutorials/own_code_in_c.md",
    ),
    *("docs/tutorials/wing.md", "docs/howto/cluster.md", "docs/howto/refusals.md", "docs/howto/restart.md"),
}


def test_the_long_pages_are_there() -> None:
    assert set(HERE) >= LONG


@pytest.mark.parametrize("page", [pytest.param(page, marks=[pytest.mark.nightly] * (page in LONG)) for page in HERE])
def test_a_page_is_as_it_says(page: str, tmp_path: Path) -> None:
    wrong = play(BLOCKS[page], tmp_path)
    assert not wrong, "\n".join(wrong)


def test_files_that_run_a_block_exist() -> None:
    named = {block.value.split()[0] for blocks in BLOCKS.values() for block in blocks if block.mark == "run by"}
    named |= {runner_of(page) for page in BLOCKS} - {""}
    assert [name for name in named if not (ROOT / name).exists()] == []


#: Commands that prepare a machine; no test runs them.
_PREPARES = re.compile(r"(apt-get|pip|\S+ -m pip) install|cd |make |[A-Z_]+=\S*$|#|$")
#: The command in a line of a shell: a subcommand of mesh-motion, a script, a program.
_RUNS = re.compile(r"mesh-motion (?P<subcommand>[a-z]+)|python (?P<script>\S+)|(\./)?(?P<program>[\w.-]+)")


def ran(block: Block) -> set[str]:
    """The commands of a shell block, in the form in which a test's text contains them."""
    found = set()
    for line in re.split(r"&&|\n", block.text):
        if not _PREPARES.match(line.strip()) and (match := _RUNS.match(line.strip())):
            found.add(f'"{match["subcommand"]}"' if match["subcommand"] else match["script"] or match["program"])
    return found


def knows(test: str, page: str, block: Block) -> bool:
    """Whether a test names the page of the block, or contains all commands of the block."""
    commands = ran(block) if block.language in ("sh", "bash") else set()
    return page in test or (bool(commands) and all(command in test for command in commands))


def test_files_that_run_a_block_name_it() -> None:
    said = [(page, block) for page, blocks in BLOCKS.items() for block in blocks if block.mark == "run by"]
    strangers = [
        f"{page}:{block.line}: {block.value}"
        for page, block in said
        if not knows((ROOT / block.value.split()[0]).read_text(encoding="utf-8"), page, block)
    ]
    assert strangers == []


def test_a_page_with_a_test_of_its_own_is_named_there() -> None:
    strangers = []
    for page, blocks in BLOCKS.items():
        test = ROOT / (runner_of(page) or "tests/docs/test_blocks.py")
        files = sorted(test.rglob("test_*.py")) if test.is_dir() else [test]
        names = {page, Path(page).name}
        if steps_of(blocks) and test.name not in ("test_blocks.py", Path(EXAMPLES).name):
            strangers += [page] * (not any(name in file.read_text("utf-8") for file in files for name in names))
    assert strangers == []


def test_blocks_that_are_not_run_give_a_reason() -> None:
    idle = [(page, block) for page, blocks in BLOCKS.items() for block in blocks if block.mark == "not run"]
    assert [f"{page}:{block.line}" for page, block in idle if len(block.value) < 10] == []
    total = sum(map(len, BLOCKS.values()))
    lines = [f"{len(idle)} of {total} blocks are not run:", *(f"  {p}:{b.line}: {b.value}" for p, b in idle)]
    sys.stdout.write("\n".join(lines) + "\n")  # pytest -rP shows them


STORY = """
<!-- file: number.py -->
```python
print("one", 1)
```
<!-- more of: number.py -->
```python
print("two 2")
```
```sh
python number.py
echo three > kept
```
<!-- output -->
```text
one …
two 2
```
<!-- fails: 3 -->
```sh
cat kept; exit 3
```
<!-- output -->
```text
three
```
```python
print(open("kept").read())
```
```toml
[method]
support_radius = 0.5
```
<!-- not run: it needs another planet -->
```sh
false
```
"""


def test_a_story_is_played(tmp_path: Path) -> None:
    assert len(blocks_of(STORY)) == 9
    assert play(blocks_of(STORY), tmp_path) == []


@pytest.mark.parametrize(
    ("right", "wrong", "found"),
    [
        ('print("two 2")', 'print("two 3")', "not printed: two 2"),
        ("python number.py\n", "python numbers.py\n", "status 2"),
        ("exit 3", "exit 4", "status 1"),
        ("support_radius", "support_radios", "unknown setting"),
        ("support_radius = 0.5", "support_radius =", "Invalid value"),
        ("<!-- not run: it needs another planet -->\n", "", "status 1"),
        ("```python\nprint(open", "```c\nprint(open", "say which"),
        ("two 2\n```\n<!--", "two 2\none 1\n```\n<!--", "not printed: one 1"),
    ],
)
def test_a_wrong_block_of_a_page_is_found(right: str, wrong: str, found: str, tmp_path: Path) -> None:
    assert right in STORY
    assert any(found in fault for fault in play(blocks_of(STORY.replace(right, wrong)), tmp_path))


def test_processes_that_a_story_leaves_are_ended(tmp_path: Path) -> None:
    story = [Block(1, "sh", "", "", "sleep 1000 > /dev/null 2>&1 & echo $! > pid\n")]
    assert play(story, tmp_path) == []
    pid = int((tmp_path / "pid").read_text())
    until = time.monotonic() + 60.0
    while psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE:
        assert time.monotonic() < until
        time.sleep(0.05)

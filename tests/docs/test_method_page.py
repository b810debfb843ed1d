"""The page that explains the method's keys knows every key."""

import re

from mesh_motion_numerics.method import KEYS

from docs.studies.page import DOCS

PAGE = (DOCS / "method.md").read_text(encoding="utf-8")


def test_every_key_is_explained_and_no_other() -> None:
    assert sorted(re.findall(r"\*\*`(\w+)`\*\*", PAGE)) == sorted(KEYS)

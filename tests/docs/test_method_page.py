"""The page that explains the method's keys knows every key."""

import re

from docs.studies.page import DOCS
from mesh_motion_server.numerics.method import KEYS

PAGE = (DOCS / "method.md").read_text(encoding="utf-8")


def test_every_key_is_explained_and_no_other() -> None:
    assert sorted(re.findall(r"\*\*`(\w+)`\*\*", PAGE)) == sorted(KEYS)


def test_every_link_leads_to_a_heading() -> None:
    for page, anchor in re.findall(r"\]\((\w+\.md)#([^)]+)\)", PAGE):
        headings = re.findall(r"^#+ (.+)$", (DOCS / page).read_text(encoding="utf-8"), re.MULTILINE)
        anchors = {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
        assert anchor in anchors, (page, anchor)

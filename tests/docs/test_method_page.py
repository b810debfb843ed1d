"""The page that explains the method's keys knows every key and every choice."""

from __future__ import annotations

import re

import pytest

from docs.studies.page import DOCS
from mesh_motion_server.numerics.method import CHOICES
from mesh_motion_server.settings import MethodSettings

PAGE = (DOCS / "method.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("key", MethodSettings.model_fields)
def test_every_key_is_explained(key: str) -> None:
    assert f"**`{key}`**" in PAGE


@pytest.mark.parametrize(("key", "choice"), [(key, choice) for key in CHOICES for choice in CHOICES[key]])
def test_every_choice_is_named(key: str, choice: str) -> None:
    assert f'`"{choice}"`' in PAGE, key


def test_no_key_is_explained_that_does_not_exist() -> None:
    assert set(re.findall(r"\*\*`(\w+)`\*\*", PAGE)) == set(MethodSettings.model_fields)


def test_every_link_leads_to_a_heading() -> None:
    for page, anchor in re.findall(r"\]\((\w+\.md)#([^)]+)\)", PAGE):
        headings = re.findall(r"^#+ (.+)$", (DOCS / page).read_text(encoding="utf-8"), re.MULTILINE)
        anchors = {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
        assert anchor in anchors, (page, anchor)

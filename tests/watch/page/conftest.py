"""What the tests of the page in a browser share."""

from collections.abc import Iterator

import chromium
import pytest


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[chromium.Browser]:
    """A tab of a headless Chromium, for all tests of a module."""
    with chromium.opened(tmp_path_factory.mktemp("profile")) as opened:
        yield opened

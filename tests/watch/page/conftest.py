"""Common parts of the tests of the page in a browser."""

from collections.abc import Iterator

import chromium
import pytest


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[chromium.Browser]:
    with chromium.opened(tmp_path_factory.mktemp("profile")) as opened:
        yield opened

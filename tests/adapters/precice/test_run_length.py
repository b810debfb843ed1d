"""Number of windows in preCICE's configuration."""

from pathlib import Path

import pytest
from mesh_motion_precice.run_length import count_windows

SCHEME = "<a><coupling-scheme:serial-implicit>{}</coupling-scheme:serial-implicit></a>"


@pytest.mark.parametrize(
    ("tags", "windows"),
    [
        ('<max-time value="5" /><time-window-size value="1e-2" />', 500),
        ('<max-time value="2.1" /><time-window-size value="0.3" />', 7),  # the quotient is more than 7 by rounding
        ('<max-time value="0.35" /><time-window-size value="0.1" />', 4),
        ('<max-time-windows value="7" /><time-window-size value="0.1" />', 7),
        ('<max-time value="5" /><time-window-size value="-1" method="first-participant" />', 0),
        ('<max-time value="soon" />', 0),
        ('<max-time value="5">', 0),
        ("", 0),
    ],
)
def test_windows_of_a_configuration(tmp_path: Path, tags: str, windows: int) -> None:
    path = tmp_path / "precice-config.xml"
    path.write_text(SCHEME.format(tags), encoding="utf-8")
    assert count_windows(path) == windows


def test_a_file_that_is_not_there_says_nothing(tmp_path: Path) -> None:
    assert count_windows(tmp_path / "none.xml") == 0

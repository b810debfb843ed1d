"""The picture of the monitor page: ``python -m tools.monitor_picture [FILE]``, by default docs/images/monitor.png.

Plays a case of ``examples/`` through a separate server and, while it runs, takes a picture of the page in a
headless Chromium (Debian's chromium and chromium-driver, selenium of the extra ``dev``).
"""

from __future__ import annotations

import argparse
import base64
import io
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.faults.server_process import ServerProcess
from tests.faults.waiting import wait_until

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "images" / "monitor.png"
#: Larger ones are not for a README.
MOST_BYTES = 150_000
_FLAGS = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader", "--hide-scrollbars")
_SHOWN = (
    "const m = globalThis.monitor; return !!(m && !m.mesh.picture.hidden "
    "&& m.history.columns.step.at(-1) >= arguments[0])"
)
#: A session may take this long to come so far, seconds.
_PATIENCE = 900.0
#: Animations, and what the page asks every three seconds: the mesh and its worst cells are of the last step then.
_SETTLES = 6.0


@contextmanager
def played(case: str, endpoint: str, folder: Path) -> Iterator[Callable[[], None]]:
    """Play an example through the server until the end of the block; yields a function that pauses it."""
    file = ROOT / "examples" / case / "case.toml"
    order = ["play", str(file), "-o", str(folder / case), "--endpoint", endpoint, "-q"]
    player = subprocess.Popen([sys.executable, "-m", "mesh_motion_server", *order])
    try:
        yield lambda: player.send_signal(signal.SIGSTOP)
    finally:
        player.send_signal(signal.SIGCONT)
        player.terminate()
        player.wait()


def picture_of(url: str, step: int, hold: Callable[[], None], *, width: int, height: int, scheme: str) -> bytes:
    """PNG of the page, when the session has reached a step and its charts and mesh are shown.

    The session is then paused: at its end it would be discarded, and a fast machine would reach the end before the
    picture.
    """
    from selenium import webdriver  # noqa: PLC0415
    from selenium.webdriver.chrome.service import Service  # noqa: PLC0415

    options = webdriver.ChromeOptions()
    for flag in _FLAGS:
        options.add_argument(flag)
    # both are given, otherwise selenium downloads them from the internet
    options.binary_location = shutil.which("chromium") or ""
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    try:
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
        driver.get(url)
        wait_until(lambda: driver.execute_script(_SHOWN, step), f"step {step} is shown", _PATIENCE)
        hold()
        time.sleep(_SETTLES)
        return base64.b64decode(driver.execute_cdp_cmd("Page.captureScreenshot", {})["data"])
    finally:
        driver.quit()


def smaller(picture: bytes) -> bytes:
    """The same PNG with 256 colours, which look the same and take half the bytes."""
    from PIL import Image  # noqa: PLC0415

    written = io.BytesIO()
    few = Image.open(io.BytesIO(picture)).convert("RGB").quantize(256, dither=Image.Dither.NONE)
    few.save(written, "PNG", optimize=True)
    return written.getvalue()


def main() -> int:
    """Play, look, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", nargs="?", type=Path, default=PICTURE)
    parser.add_argument("--case", default="turek_hron_flag", help="a folder of examples/")
    parser.add_argument("--step", type=int, default=40, help="take the picture when this step is committed")
    parser.add_argument("--width", type=int, default=1440)
    parser.add_argument("--height", type=int, default=1010)
    parser.add_argument("--scheme", choices=("light", "dark"), default="light")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        server = ServerProcess(Path(folder) / "server", monitor="127.0.0.1:0")
        server.start()
        try:
            url = server.announced["monitor"].replace("tcp://", "http://")
            with played(given.case, server.announced["endpoint"], Path(folder)) as hold:
                made = picture_of(url, given.step, hold, width=given.width, height=given.height, scheme=given.scheme)
        finally:
            server.stop()
    made = smaller(made)
    given.file.write_bytes(made)
    if len(made) > MOST_BYTES:
        sys.stderr.write(
            f"{len(made)} bytes, more than {MOST_BYTES}: too large for the README, a smaller window makes less\n"
        )
    return int(len(made) > MOST_BYTES)


if __name__ == "__main__":
    sys.exit(main())

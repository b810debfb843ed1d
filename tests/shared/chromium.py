"""A headless Chromium with Debian's driver, and the reason if there is none."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.faults.waiting import wait_until

#: Seconds; the page waits for every process that computes, here for the other tests.
_PATIENCE = 200.0
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
DRIVER = shutil.which("chromedriver")
AXE = Path(__file__).parents[2] / "out" / "vendor" / "axe-core" / "axe.min.js"


def missing() -> str:
    """The missing programs; empty if a browser can be started."""
    if CHROMIUM is None or DRIVER is None:
        return "chromium and chromium-driver are not installed (.ci/run installs them)"
    try:
        import selenium  # noqa: F401, PLC0415
    except ImportError:
        return "selenium is not installed (the extra dev)"
    return ""


@contextmanager
def opened(profile: Path) -> Iterator[Browser]:
    """Yield a browser until the end of the block."""
    from selenium import webdriver  # noqa: PLC0415
    from selenium.webdriver.chrome.service import Service  # noqa: PLC0415

    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM or ""
    for flag in (
        "--headless=new",
        "--no-sandbox",
        "--disable-dev-shm-usage",
        "--enable-unsafe-swiftshader",
        "--use-angle=swiftshader",
        "--hide-scrollbars",
        f"--user-data-dir={profile}",
    ):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(DRIVER))
    driver.set_script_timeout(120)
    try:
        yield Browser(driver)
    finally:
        driver.quit()


class Browser:
    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def show(self, url: str, *, width: int = 1400, height: int = 1000, scheme: str = "light") -> None:
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
        self.driver.get("about:blank")
        self.driver.get(url)

    @contextmanager
    def prepared(self, script: str) -> Iterator[None]:
        """Run a script before those of each page that is opened within the block."""
        added = self.driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": script})
        try:
            yield
        finally:
            self.driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", added)

    def run(self, script: str, *arguments: Any) -> Any:
        return self.driver.execute_script(script, *arguments)

    def text(self, selector: str) -> str:
        return str(self.run("return document.querySelector(arguments[0])?.innerText ?? ''", selector))

    def texts(self, selector: str) -> list[str]:
        found: list[str] = self.run(
            "return [...document.querySelectorAll(arguments[0])].map((e) => e.innerText)", selector
        )
        return found

    def wait(self, holds: Callable[[], Any], what: str) -> Any:
        try:
            return wait_until(holds, what, _PATIENCE)
        except Exception as error:
            raise AssertionError(f"{what}; the browser said: {self.complaints()}") from error

    def keys(self, *names: str) -> None:
        """Press keys, one after the other, where the focus is."""
        from selenium.webdriver.common.action_chains import ActionChains  # noqa: PLC0415
        from selenium.webdriver.common.keys import Keys  # noqa: PLC0415

        chain = ActionChains(self.driver)
        for name in names:
            chain.send_keys(getattr(Keys, name, name))
        chain.perform()

    def click(self, selector: str, x: int, y: int) -> None:
        """Click this many pixels from the element's middle."""
        from selenium.webdriver.common.action_chains import ActionChains  # noqa: PLC0415
        from selenium.webdriver.common.by import By  # noqa: PLC0415

        found = self.driver.find_element(By.CSS_SELECTOR, selector)
        ActionChains(self.driver).move_to_element_with_offset(found, x, y).click().perform()

    def focused(self) -> str:
        """The element with the focus: its id, else its class, else its text."""
        script = "const e = document.activeElement; return e.id || e.className || e.innerText"
        return str(self.run(script))

    def complaints(self) -> list[str]:
        """The page's errors since the last call, except those about a server that is away."""
        lines = [line["message"] for line in self.driver.get_log("browser") if line["level"] == "SEVERE"]
        return [line for line in lines if "ERR_" not in line]

    def violations(self) -> list[str]:
        self.run(AXE.read_text(encoding="utf-8"))
        tags = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"]
        found = self.driver.execute_async_script(
            "const done = arguments[1]; axe.run({runOnly: arguments[0]}).then("
            "(r) => done(r.violations.map((v) => [v.id, v.nodes.map((n) => n.html.slice(0, 120))])))",
            tags,
        )
        return [json.dumps(violation) for violation in found]

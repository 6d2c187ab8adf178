"""A headless Chromium for tests, or a reason why there is none."""

from __future__ import annotations

import io
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from waiting import wait_until

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--window-size=1280,1000",
    "--force-device-scale-factor=1",
)

_DRAWN = """
const done = arguments[0];
let left = 24;
const next = () => left-- ? requestAnimationFrame(next) : done();
next();
"""
"""Waits until the browser has drawn the page some more times: one in three dimensions is drawn in the frames that follow."""


def missing() -> str | None:
    """Why no browser can be started; None if one can."""
    try:
        import selenium  # noqa: F401
    except ImportError:
        return "selenium is not installed"
    for program in ("chromium", "chromedriver"):
        if shutil.which(program) is None:
            return f"no {program} on this machine (Debian: apt-get install chromium chromium-driver)"
    return None


def start(profile: Path) -> Any:
    """Start a browser whose network is cut off and whose console is recorded."""
    from selenium import webdriver
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service

    options = Options()
    options.binary_location = shutil.which("chromium") or ""
    for flag in (*FLAGS, f"--user-data-dir={profile}", "--host-resolver-rules=MAP * ~NOTFOUND"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    return webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver") or ""))


def open_page(driver: Any, path: Path) -> None:
    """Open a page and wait until its script is done."""
    driver.get_log("browser")
    driver.get(path.as_uri())
    wait_until(lambda: driver.execute_script("return document.documentElement.dataset.ready") == "yes")


def errors(driver: Any) -> list[str]:
    """Severe messages of the page's console."""
    return [entry["message"] for entry in driver.get_log("browser") if entry["level"] == "SEVERE"]


def picture_of(driver: Any, name: str) -> np.ndarray:
    """Screenshot of an element of the page, (height, width, 3)."""
    from selenium.webdriver.common.by import By

    driver.execute_script("document.getElementById(arguments[0]).scrollIntoView({block: 'center'})", name)
    driver.execute_async_script(_DRAWN)
    return np.asarray(Image.open(io.BytesIO(driver.find_element(By.ID, name).screenshot_as_png)).convert("RGB"), float)

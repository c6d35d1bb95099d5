"""Chromium without a window, driven through WebDriver, and what a test may ask of a page."""

import base64
import io
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.actions.wheel_input import ScrollOrigin
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.wait import WebDriverWait

# Roles that users operate, or that are announced: each needs a name.
NAMED_ROLES = {
    "application", "button", "combobox", "DisclosureTriangle", "image", "link", "radio", "region", "slider",
    "splitter", "separator", "table",
}  # fmt: skip


def find_program(*names: str) -> str:
    """The first of these programs that is installed; without one the test fails."""
    found = next((path for path in map(shutil.which, names) if path), None)
    if found is None:
        pytest.fail(f"none of {', '.join(names)} is installed: tools/install-chromium")
    return found


class Browser:
    """One tab. Sizes are in CSS pixels, of which each is a pixel of the screen."""

    def __init__(self) -> None:
        options = webdriver.ChromeOptions()
        options.binary_location = find_program("chromium", "chromium-browser", "google-chrome")
        arguments = ["--headless=new", "--hide-scrollbars", "--force-device-scale-factor=1"]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            arguments.append("--no-sandbox")  # Chromium's sandbox does not work for root.
        for argument in arguments:
            options.add_argument(argument)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        self.driver = webdriver.Chrome(options, Service(find_program("chromedriver")))
        self.resize(1280)

    def quit(self) -> None:
        self.driver.quit()

    def resize(self, width: int, height: int = 1000) -> None:
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)

    def prefer(self, scheme: str) -> None:
        """Sets what the user prefers: `light` or `dark`."""
        feature = {"name": "prefers-color-scheme", "value": scheme}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})

    def open(self, page: Path) -> None:
        """Opens a page as a double click on the file does; what was logged before is forgotten."""
        self.console(), self.requests()
        self.driver.get(page.as_uri())

    def js(self, script: str, *arguments: object) -> object:
        """Runs the body of a function in the page; returns what it returns."""
        return self.driver.execute_script(script, *arguments)

    def wait(self, script: str) -> None:
        """Waits until the script returns something true."""
        WebDriverWait(self.driver, 20).until(lambda driver: driver.execute_script(script))

    def find(self, selector: str) -> WebElement:
        return self.driver.find_element("css selector", selector)

    def find_all(self, selector: str) -> list[WebElement]:
        return self.driver.find_elements("css selector", selector)

    def box(self, selector: str) -> tuple[float, float, float, float]:
        """Left, top, width and height of an element, in the window."""
        box = self.js(
            "return document.querySelector(arguments[0]).getBoundingClientRect().toJSON()", selector
        )
        return box["x"], box["y"], box["width"], box["height"]

    def center(self, selector: str) -> None:
        """Scrolls until an element is in the middle of the window."""
        self.js("document.querySelector(arguments[0]).scrollIntoView({ block: 'center' })", selector)

    def press(self, *keys: str) -> None:
        """Types keys, one after the other, where the focus is."""
        ActionChains(self.driver).send_keys(*keys).perform()

    def press_with(self, modifier: str, key: str) -> None:
        ActionChains(self.driver).key_down(modifier).send_keys(key).key_up(modifier).perform()

    def move_to(self, x: float, y: float) -> None:
        """Moves the pointer to a place in the window."""
        self.actions().move(x, y).perform()

    def actions(self) -> "Pointer":
        return Pointer(self.driver)

    def console(self) -> list[str]:
        """What was logged since the last call: errors, warnings and all else."""
        return [entry["message"] for entry in self.driver.get_log("browser")]

    def requests(self) -> list[str]:
        """The addresses that were asked for since the last call, without data in the page itself, and
        without what the page's policy forbade."""
        found = {}
        for entry in self.driver.get_log("performance"):
            message = json.loads(entry["message"])["message"]
            details = message["params"]
            if message["method"] == "Network.requestWillBeSent":
                found[details["requestId"]] = details["request"]["url"]
            elif details.get("blockedReason") == "csp":
                found.pop(details["requestId"])
        return [url for url in found.values() if not url.startswith(("data:", "blob:"))]

    def canvas(self) -> np.ndarray:
        """The pixels of the comparer's canvas, `[y, x, rgba]`."""
        url = str(self.js("return document.getElementById('canvas').toDataURL('image/png')"))
        return decode_png(base64.b64decode(url.split(",")[1]))

    def screenshot(self) -> np.ndarray:
        """The whole page, `[y, x, rgba]`."""
        size = self.driver.execute_cdp_cmd("Page.getLayoutMetrics", {})["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}
        options = {"captureBeyondViewport": True, "clip": clip}
        shot = self.driver.execute_cdp_cmd("Page.captureScreenshot", options)
        return decode_png(base64.b64decode(shot["data"]))

    def accessible(self) -> list[tuple[str, str]]:
        """Role and name of all that assistive programs see."""
        tree = self.driver.execute_cdp_cmd("Accessibility.getFullAXTree", {})["nodes"]
        seen = [node for node in tree if not node["ignored"]]
        return [(node["role"]["value"], node.get("name", {}).get("value", "").strip()) for node in seen]

    def nameless(self) -> list[str]:
        """The roles of what has no name, but needs one."""
        return [role for role, name in self.accessible() if role in NAMED_ROLES and not name]


class Pointer:
    """A sequence of actions of the mouse, at places in the window."""

    def __init__(self, driver: webdriver.Chrome) -> None:
        self.chain = ActionChains(driver, duration=0)
        self.pointer = self.chain.w3c_actions.pointer_action

    def move(self, x: float, y: float) -> "Pointer":
        self.pointer.move_to_location(round(x), round(y))
        return self

    def down(self) -> "Pointer":
        self.pointer.pointer_down()
        return self

    def up(self) -> "Pointer":
        self.pointer.pointer_up()
        return self

    def wheel(self, x: float, y: float, delta: int) -> "Pointer":
        self.chain.scroll_from_origin(ScrollOrigin.from_viewport(round(x), round(y)), 0, delta)
        return self

    def perform(self) -> None:
        self.chain.perform()


def decode_png(data: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGBA"))

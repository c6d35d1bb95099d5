"""Draws the comparer of a page of `nst report`, as the README shows it.

    python tests/peers/report_picture.py results.html 8 auto docs/report.jpg

with the Python of tools/python-env tests/peers/requirements.txt.
The number is that of the samples per pixel; the method's picture is right of the splitter, and the plain
estimate left of it.
"""

import io
import sys
from pathlib import Path

from PIL import Image
from selenium.webdriver.support.select import Select

from browser import Browser
from report_film import settle

WIDTH = 560

if __name__ == "__main__":
    page, spp, method, output = sys.argv[1:]
    browser = Browser()
    try:
        browser.resize(WIDTH)
        browser.open(Path(page).resolve())
        browser.find(f"#spp label:has(input[value='{spp}'])").click()
        Select(browser.find("#other")).select_by_visible_text(method)
        settle(browser)
        picture = Image.open(io.BytesIO(browser.find("#stage").screenshot_as_png))
        picture.convert("RGB").save(output, quality=88)
    finally:
        browser.quit()

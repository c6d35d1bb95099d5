"""The page of `nst report` in Chromium: its table, charts, names, looks, and that it needs no network."""

import json
import re
from pathlib import Path

import pytest
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement

from browser import Browser
from conftest import Nst
from report_film import FILM, METHODS, ODD, settle, write_table


def column(browser: Browser, label: str) -> list[str]:
    """The texts of a column of the table."""
    heads = browser.js(
        "return [...arguments[0].tHead.rows[0].cells].map((cell) => cell.innerText)", table(browser)
    )
    place = [str(head).rstrip(" ↑↓") for head in heads].index(label)
    script = "return [...arguments[0].tBodies[0].rows].map((row) => row.cells[arguments[1]].innerText)"
    return browser.js(script, table(browser), place)


def table(browser: Browser) -> WebElement:
    return browser.find("#summaries")


def is_sorted(texts: list[str], descending: bool = False) -> bool:
    """Whether numbers are in order, and empty cells last."""
    numbers = [float(text.replace("−", "-")) for text in texts if text != "–"]
    ordered = sorted(numbers, reverse=descending)
    return ordered == numbers and all(text == "–" for text in texts[len(numbers) :])


def test_the_table_sorts(page: Browser) -> None:
    assert column(page, "method") == [method for method in METHODS for _ in (0, 1)] + ["failing"]
    assert not is_sorted(column(page, "MSE")) and not is_sorted(["–", "1"]) and not is_sorted(["10", "9"])
    head = "//table[@id='summaries']//button[starts-with(., 'MSE')]"
    button = page.driver.find_element("xpath", head)
    button.click()
    assert is_sorted(column(page, "MSE")) and len(set(column(page, "MSE"))) == 7
    order = [head.get_attribute("aria-sort") for head in page.find_all("#summaries thead th")]
    assert sorted(order) == ["ascending"] + ["none"] * 19
    button.send_keys(Keys.ENTER)
    assert is_sorted(column(page, "MSE"), descending=True)
    assert page.find("#summaries [aria-sort='descending']").text.startswith("MSE")
    page.driver.find_element("xpath", head.replace("MSE", "method")).send_keys(Keys.ENTER)
    assert column(page, "method") == ["auto"] * 2 + ["failing"] + ["none"] * 2 + [ODD] * 2
    assert page.find("#failures li").text == "failing at 8 spp: it needs <em>more</em> samples"
    # Of as many samples, auto has the lowest MSE, ratio, relMSE and SMAPE.
    best = page.find_all("#summaries tr:has(strong) th")
    assert [head.text for head in best] == ["auto"] * 2
    assert len(page.find_all("#summaries strong")) == 8


def test_marks_say_their_values(page: Browser) -> None:
    marks = page.find_all("#charts > figure .mark")
    # Three plots: against time and against samples, and at equal time.
    assert len(marks) >= 2 * len(METHODS) * 2
    labels = [mark.get_attribute("aria-label") for mark in marks]
    assert any(ODD in label and "32" in label for label in labels)
    tip = page.find("#charts .tip")
    assert not tip.is_displayed()
    page.center("#charts .mark:nth-child(2)")
    left, top, width, height = page.box("#charts .mark:nth-child(2)")
    page.move_to(left + width / 2, top + height / 2)
    assert tip.is_displayed() and tip.text == labels[1].strip()
    page.move_to(2, 2)
    assert not tip.is_displayed()
    page.js("const title = arguments[0]; title.tabIndex = -1; title.focus()", page.find("#charts-title"))
    for keys, index in [(Keys.TAB, 0), (Keys.ARROW_RIGHT, 1), (Keys.ARROW_LEFT * 2, len(marks) - 1)]:
        page.press(keys)
        assert page.driver.switch_to.active_element == marks[index]
        assert tip.is_displayed() and tip.text == labels[index].strip()
    page.press(Keys.TAB)
    assert page.driver.switch_to.active_element.tag_name == "summary"
    assert page.js("return document.querySelector('.chart img').naturalWidth") > 0


def test_names_are_texts(page: Browser) -> None:
    assert page.find("h1").text == "a <i>scene</i> &amp; more"
    assert page.driver.title == "a <i>scene</i> &amp; more – nst report"
    assert page.find_all("b, i, em, u") == []
    assert ODD in page.find("#other").text
    data = json.loads(page.js("return document.getElementById('data').textContent"))
    assert data["scene"] == "a <i>scene</i> &amp; more"


def test_assistive_programs_know_everything(page: Browser) -> None:
    seen = page.accessible()
    for wanted in [
        ("radio", "auto"), ("radio", "error map"), ("slider", "Exposure"), ("columnheader", "MSE"),
        ("combobox", "Right of the splitter"), ("button", "zoom in"),
        ("application", "Pictures, side by side at the splitter"),
        ("image", "MSE against time and samples"), ("heading", "Pictures"), ("region", "Table"),
    ]:  # fmt: skip
        assert wanted in seen, wanted
    assert any(name == "Splitter between the two pictures" for _, name in seen)
    assert page.nameless() == []
    page.js("document.getElementById('canvas').removeAttribute('aria-label')")
    assert page.nameless() == ["application"]


def faults(browser: Browser) -> list[str]:
    """What is wrong with the page as it is seen: parts that are missing, blank, or too wide."""
    found = []
    picture = browser.screenshot().astype(int)
    width = browser.js("return innerWidth")
    if browser.js("return document.documentElement.scrollWidth") > width:
        found.append("too wide")
    for selector in ["header", "#charts img", "#stage", "#readout", "#summaries", "#facts"]:
        box = browser.js(
            "const box = document.querySelector(arguments[0])?.getBoundingClientRect();"
            "return box && [box.left, box.top + scrollY, box.right, box.bottom + scrollY]",
            selector,
        )
        if box is None:
            found.append(f"{selector} is missing")
            continue
        left, top, right, bottom = (round(length) for length in box)
        part = picture[max(top, 0) : bottom, max(left, 0) : min(right, width), :3]
        # Text alone makes a deviation of about 20.
        if part.size == 0 or part.std() < 5:
            found.append(f"{selector} is blank")
    return found


@pytest.mark.parametrize("width", [1280, 400])
def test_the_page_looks_whole(page: Browser, width: int) -> None:
    page.resize(width)
    settle(page)
    light = page.screenshot()[:, :, :3]
    assert faults(page) == []
    page.prefer("dark")
    assert faults(page) == []
    dark = page.screenshot()[:, :, :3]
    # Paper is bright or dark; so is a chart's, which is a drawing of its own.
    left, top, *_ = page.box(".chart img")
    chart = left + 4, top + 4 + page.js("return scrollY")
    for x, y in [(2, 2), tuple(map(int, chart))]:
        assert light[y, x].min() > 240 and dark[y, x].max() < 60
    page.js("document.getElementById('facts').style.width = '3000px'")
    page.js(
        "document.getElementById('summaries').remove(); document.getElementById('stage').style.opacity = 0"
    )
    assert faults(page) == ["too wide", "#stage is blank", "#summaries is missing"]


def test_without_pictures(browser: Browser, nst: Nst, tmp_path: Path) -> None:
    write_table(tmp_path / "results.csv")
    nst("report", "results.csv")
    browser.open(tmp_path / "results.html")
    assert "'results.exr' is missing" in browser.find("#no-pictures").text
    assert not browser.find("#with-pictures").is_displayed()
    assert browser.find("#summaries").is_displayed()
    assert browser.console() == []


def test_the_policy_keeps_the_page_from_networks(browser: Browser, nst: Nst, tmp_path: Path) -> None:
    """And the tests see requests, and what is logged."""
    write_table(tmp_path / "results.csv")
    nst("report", "results.csv")
    page = tmp_path / "results.html"
    text = page.read_text()
    wrong = '<img src="missing.png"><script>console.warn("here")</script>'
    page.write_text(text.replace("<header", wrong + "<header"))
    browser.open(page)
    assert any("Content Security Policy" in message for message in browser.console())
    assert browser.requests() == [page.as_uri()]
    page.write_text(re.sub("<meta http-equiv.*?>", "", text.replace("<header", wrong + "<header")))
    browser.open(page)
    assert any("here" in message for message in browser.console())
    assert (tmp_path / "missing.png").as_uri() in browser.requests()


def test_a_damaged_picture_is_reported(browser: Browser, nst: Nst, tmp_path: Path) -> None:
    write_table(tmp_path / "results.csv")
    FILM.write_exr(tmp_path / "results.exr")
    nst("report", "results.csv")
    page = tmp_path / "results.html"
    page.write_text(re.sub(r'(id="picture-reference">)[^<]*', r"\1eJwDAAAAAAE=", page.read_text()))
    browser.open(page)
    browser.press("1")
    browser.wait("return !document.getElementById('failure').hidden")
    assert "cannot be shown" in browser.find("#failure").text

"""The comparer of the page of `nst report`: what keys, wheel, pointer and buttons show."""

import re
from pathlib import Path

import numpy as np
from PIL import Image
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.select import Select

from browser import Browser
from conftest import Nst
from report_film import FILM, HEIGHT, METHODS, ODD, REFERENCE, WIDTH, settle, shown, shown_errors

# Rounding to bytes: Chromium's powers and NumPy's may differ in the last place.
ROUNDING = 1


# The places of the film's pixels on the canvas.


def fitted(canvas: np.ndarray) -> tuple[float, float, float]:
    """Scale, left and top of a picture that fills the canvas."""
    height, width = canvas.shape[:2]
    scale = min(width / WIDTH, height / HEIGHT)
    return scale, (width - scale * WIDTH) / 2, (height - scale * HEIGHT) / 2


def middles(canvas: np.ndarray) -> np.ndarray:
    """The colours `[y, x, rgb]` in the middle of each of the film's pixels."""
    scale, left, top = fitted(canvas)
    y = (top + (np.arange(HEIGHT) + 0.5) * scale).astype(int)
    x = (left + (np.arange(WIDTH) + 0.5) * scale).astype(int)
    return canvas[y[:, None], x[None, :], :3].astype(int)


def same(found: np.ndarray, expected: np.ndarray) -> bool:
    return found.shape == expected.shape and bool((np.abs(found - expected) <= ROUNDING).all())


def looks_like(browser: Browser, expected: np.ndarray) -> bool:
    settle(browser)
    return same(middles(browser.canvas()), expected)


def spot(browser: Browser, x: float, y: float) -> tuple[float, float]:
    """The place in the window of a point of the film that fills the canvas."""
    scale, left, top = fitted(browser.canvas())
    start, above, *_ = browser.box("#canvas")
    return start + left + x * scale, above + top + y * scale


def place(browser: Browser) -> str:
    return re.match(r"Pixel \((.*?)\)", browser.find("#place").text)[1]


def names(browser: Browser) -> list[str]:
    return [element.text for element in browser.find_all("#pictures label span")]


def test_keys_flip_pictures_in_place(page: Browser) -> None:
    assert names(page) == ["reference", "none (plain)", "auto", ODD, "other <u>"]
    page.press("s")
    pictures = [REFERENCE, *(FILM.layers[f"{method}.32"] for method in METHODS)]
    for key, picture in enumerate(pictures, 1):
        page.press(str(key))
        assert looks_like(page, shown(picture))
        assert page.find("#left-name").text == names(page)[key - 1]
        # The comparison sees the wrong picture, and swapped channels.
        assert not looks_like(page, shown(pictures[key - 2]))
        assert not looks_like(page, shown(picture[:, :, ::-1]))
    page.press("5")
    assert looks_like(page, shown(FILM.layers["auto.32"]))
    page.press("9")  # There is none.
    assert page.find("#left-name").text == "other <u>"
    page.find("#spp label").click()
    page.press("2")
    assert looks_like(page, shown(FILM.layers["none.8"]))
    assert (middles(page.canvas())[[4, 6], [5, 7]] == [255, 0, 255]).all()


def test_exposure_and_tone_curve(page: Browser) -> None:
    page.press("s", "3")
    auto = FILM.layers["auto.32"]
    for keys, stops in [("....", 2.0), (",,,,,,", -1.0)]:
        page.press(*keys)
        assert looks_like(page, shown(auto, stops))
        assert not looks_like(page, shown(auto, stops + 0.25))
        assert page.find("#stops").text == f"{stops:+.2f} stops".replace("-", "−")
    page.press("t")
    assert looks_like(page, shown(auto, -1.0, "filmic"))
    assert not looks_like(page, shown(auto, -1.0))
    page.find("#exposure").send_keys(Keys.ARROW_RIGHT)
    assert looks_like(page, shown(auto, -0.75, "filmic"))
    page.find("#curve label").click()
    assert looks_like(page, shown(auto, -0.75))


def test_error_maps(page: Browser) -> None:
    assert not page.find("#legend").is_displayed()
    page.press("s", "e")
    for key, layer in [("2", "none.32"), ("4", f"{ODD}.32")]:
        page.press(key)
        assert looks_like(page, shown_errors(FILM.layers[layer], REFERENCE))
        assert not looks_like(page, shown_errors(FILM.layers["auto.32"], REFERENCE))
    assert page.find("#legend").is_displayed()
    page.find("#spp label").click()
    page.press("2")
    assert looks_like(page, shown_errors(FILM.layers["none.8"], REFERENCE))
    page.find("#mode label").click()
    assert looks_like(page, shown(FILM.layers["none.8"]))


def test_error_maps_are_those_of_nst_compare(nst: Nst, tmp_path: Path) -> None:
    FILM.write_exr(tmp_path / "x.exr")
    command = ("compare", "x.exr", "x.exr", "--layer", "auto.32", "--reference-layer", "", "-q")
    # The same file as picture and reference is one of two names.
    (tmp_path / "y.exr").write_bytes((tmp_path / "x.exr").read_bytes())
    nst(command[0], command[1], "y.exr", *command[3:], "--error-map", "map.png")
    found = np.asarray(Image.open(tmp_path / "map.png").convert("RGB")).astype(int)
    assert same(found, shown_errors(FILM.layers["auto.32"], REFERENCE))
    assert not same(found, shown_errors(FILM.layers["none.32"], REFERENCE))


def test_wheel_zooms_to_the_pixel_under_the_pointer(page: Browser) -> None:
    page.press("s", "2")
    auto = shown(FILM.layers["none.32"])
    x, y = spot(page, 22.5, 20.5)
    page.move_to(x, y)
    assert place(page) == "22, 20"
    before = fitted(page.canvas())[0]
    page.actions().wheel(x, y, -100).wheel(x, y, -50).perform()
    settle(page)
    page.move_to(x + 1, y)
    assert place(page) == "22, 20"
    canvas, scale = page.canvas().astype(int), before * 2**0.75
    start, above, *_ = page.box("#canvas")
    column, row = round(x - start), round(y - above)
    # Enlarged pixels are squares of one colour, three of them on each side.
    for dy in (-3, 0, 3):
        for dx in (-3, 0, 3):
            near = (
                [int(row + (dy + s) * scale) for s in (-0.4, 0.4)],
                [int(column + (dx + s) * scale) for s in (-0.4, 0.4)],
            )
            square = canvas[near[0][0] : near[0][1], near[1][0] : near[1][1], :3]
            assert square.size > 0
            # The frame around the chosen pixel is outside of it.
            inner = square[2:-2, 2:-2].reshape(-1, 3)
            assert same(inner, np.broadcast_to(auto[20 + dy, 22 + dx], inner.shape))
            assert not same(inner, np.broadcast_to(auto[20 + dy, 23 + dx], inner.shape))
    page.actions().move(x, y).down().move(x - 40, y + 25).move(x - 90, y + 50).up().perform()
    assert place(page) == "22, 20"
    page.move_to(x, y)
    assert place(page) == f"{int(22.5 + 90 / scale)}, {int(20.5 - 50 / scale)}"
    page.press("0")
    assert looks_like(page, auto)
    page.find("#zoom [value=in]").click()
    assert not looks_like(page, auto)


def test_values_of_pixels(page: Browser) -> None:
    page.find("#other").send_keys(Keys.TAB)
    page.press(Keys.ARROW_DOWN)  # The first is in the middle.
    page.press_with(Keys.SHIFT, Keys.ARROW_LEFT)
    page.press(Keys.ARROW_UP, Keys.ARROW_UP, Keys.ARROW_RIGHT)
    x, y = map(int, place(page).split(", "))
    assert (x, y) == (WIDTH // 2 - 9, HEIGHT // 2 - 2)
    rows = [row.text.replace("−", "-") for row in page.find_all("#readout tbody tr")]
    for text, (name, layer) in zip(
        rows, [("none (plain)", "none.32"), ("auto", "auto.32"), ("reference", "")], strict=True
    ):
        values = FILM.layers[layer][y, x]
        found = text.removeprefix(name).split()
        assert len(found) == 4
        # Three digits are shown.
        assert np.allclose([float(value) for value in found[:3]], values, rtol=5e-3, atol=0)
        if layer:
            error = ((values - REFERENCE[y, x]) ** 2 / (REFERENCE[y, x] ** 2 + 0.01)).mean()
            assert np.isclose(float(found[3]), error, rtol=5e-2, atol=0)
            assert not np.allclose([float(value) for value in found[:3]], REFERENCE[y, x], rtol=5e-3, atol=0)
    spoken = page.js("return document.getElementById('spoken').textContent")
    assert spoken.startswith(f"Pixel {x}, {y}. none (plain): ")
    page.find("#spp label").click()
    page.move_to(*spot(page, 5.5, 4.5))
    assert "not finite" in page.find("#readout tbody").text


def halves(browser: Browser, share: float, left: np.ndarray, right: np.ndarray) -> bool:
    """Whether one canvas is seen up to a share of the width, and the other beyond."""
    settle(browser)
    canvas = browser.canvas()
    edge = round(share * canvas.shape[1])
    return bool((canvas == np.concatenate([left[:, :edge], right[:, edge:]], axis=1)).all())


def test_splitter(page: Browser) -> None:
    page.press("s")
    alone = []
    for key in "432":
        page.press(key)
        settle(page)
        alone.append(page.canvas())
    odd, auto, plain = alone
    page.press("s")
    assert halves(page, 0.5, plain, auto)
    assert not halves(page, 0.5, auto, plain) and not halves(page, 0.49, plain, auto)
    left, top, width, height = page.box("#stage")
    x = [left + share * width for share in (0.5, 0.4, 0.25)]
    y = top + 0.3 * height
    page.actions().move(x[0], y).down().move(x[1], y).move(x[2], y).up().perform()
    assert halves(page, 0.25, plain, auto)
    splitter = page.find("#splitter")
    assert splitter.get_attribute("aria-valuenow") == "25"
    page.press_with(Keys.SHIFT, "4")
    assert halves(page, 0.25, plain, odd)
    for key, now in [(Keys.ARROW_RIGHT, "26"), (Keys.END, "100"), (Keys.ARROW_LEFT, "99"), (Keys.HOME, "0")]:
        splitter.send_keys(key)
        assert splitter.get_attribute("aria-valuenow") == now
    assert halves(page, 0, plain, odd)
    page.press("s")
    assert halves(page, 1, plain, odd) and not splitter.is_displayed()
    page.press("s")
    assert halves(page, 0, plain, odd)
    Select(page.find("#other")).select_by_visible_text("nothing")
    assert halves(page, 1, plain, odd)

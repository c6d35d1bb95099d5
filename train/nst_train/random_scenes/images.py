"""Images of random scenes, in formats without compression: the same bytes on every machine."""

import struct

import numpy as np

TEXELS = 64
SKY_HEIGHT = 64


def bmp(colours: np.ndarray) -> bytes:
    """A 24-bit BMP of `[row, column, rgb]` in 0 to 1, top row first."""
    height, width, _ = colours.shape
    bgr = (np.clip(colours, 0, 1)[::-1, :, ::-1] * 255 + 0.5).astype(np.uint8)
    padding = -3 * width % 4
    body = np.pad(bgr.reshape(height, 3 * width), ((0, 0), (0, padding))).tobytes()
    info = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 24, 0, len(body), 2835, 2835, 0, 0)
    return struct.pack("<2sIHHI", b"BM", 54 + len(body), 0, 0, 54) + info + body


def hdr(radiance: np.ndarray) -> bytes:
    """A flat Radiance picture of `[row, column, rgb]`, top row first."""
    height, width, _ = radiance.shape
    largest = radiance.max(-1)
    mantissa, exponent = np.frexp(largest)
    scale = np.where(largest > 1e-30, mantissa * 256 / np.maximum(largest, 1e-30), 0)
    texels = np.empty((height, width, 4), np.uint8)
    texels[..., :3] = radiance * scale[..., None]
    texels[..., 3] = np.where(largest > 1e-30, exponent + 128, 0)
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n"
    return head.encode() + texels.tobytes()


def noise(rng: np.random.Generator, height: int, width: int, finest: int) -> np.ndarray:
    """A random function in 0 to 1 that repeats, of waves up to `finest` periods, `[row, column]`."""
    y, x = np.mgrid[:height, :width]
    total = np.zeros((height, width))
    for _ in range(24):
        frequency = np.exp(rng.uniform(0, np.log(finest)))
        angle, phase = rng.uniform(0, 2 * np.pi, 2)
        fx, fy = np.round(frequency * np.cos(angle)), np.round(frequency * np.sin(angle))
        total += np.cos(2 * np.pi * (fx * x / width + fy * y / height) + phase) / np.sqrt(frequency)
    return (total - total.min()) / max(np.ptp(total), 1e-9)


def texture(rng: np.random.Generator, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """A board, stripes, or noise between two colours, `[row, column, rgb]`."""
    y, x = np.mgrid[:TEXELS, :TEXELS] / TEXELS
    periods = 2 ** int(rng.integers(0, 5))
    kind = rng.integers(3)
    if kind == 0:
        share = ((x * 2 * periods).astype(int) + (y * 2 * periods).astype(int)) % 2
    elif kind == 1:
        share = (x * 2 * periods).astype(int) % 2
    else:
        share = noise(rng, TEXELS, TEXELS, 2 * periods)
    return first + share[..., None] * (second - first)


def sky(rng: np.random.Generator) -> np.ndarray:
    """A gradient with clouds over a dark ground, and mostly a sun of some size, `[row, column, rgb]`."""
    height, width = SKY_HEIGHT, 2 * SKY_HEIGHT
    up = np.cos((np.arange(height) + 0.5) / height * np.pi)[:, None, None]
    zenith = np.array([0.25, 0.45, 1.0]) * rng.uniform(0.2, 1)
    horizon = 1 - rng.uniform(0, 0.6, 3) * [0, 0.5, 1]
    ground = rng.uniform(0.02, 0.3) * np.ones(3)
    blend = np.clip(up, 0, 1) ** rng.uniform(0.3, 1)
    radiance = np.where(up > 0, horizon + blend * (zenith - horizon), ground) * np.ones((1, width, 1))
    clouds = noise(rng, height, width, 12)[..., None] * (up > 0)
    radiance += rng.uniform(0, 1) * np.clip(2 * clouds - 1, 0, 1)
    if rng.random() < 0.75:
        elevation, around = rng.uniform(0.15, 1.3), rng.uniform(0, 2 * np.pi)
        theta = (np.arange(height) + 0.5)[:, None] / height * np.pi
        phi = (np.arange(width) + 0.5) / width * 2 * np.pi
        cosine = np.cos(theta) * np.sin(elevation)
        cosine = cosine + np.sin(theta) * np.cos(elevation) * np.cos(phi - around)
        size = 10 ** rng.uniform(-1.3, -0.3)
        inside = cosine > min(np.cos(size), cosine.max() - 1e-9)
        weight = (inside * np.sin(theta)).sum()
        radiance[inside] += 10 ** rng.uniform(2.5, 4) / weight * np.array([1, 0.9, 0.75])
    return radiance


def fractal(rng: np.random.Generator, size: int, falloff: float) -> np.ndarray:
    """A random function in 0 to 1 that repeats, `[row, column]`, of octaves k that weigh 2^(-falloff · k)."""
    total = np.zeros((size, size))
    cells = 2
    while cells <= size:
        grid = rng.uniform(-1, 1, (cells, cells))
        place = np.arange(size) * cells / size
        low, share = place.astype(int), place % 1
        rows = grid[low] * (1 - share[:, None]) + grid[(low + 1) % cells] * share[:, None]
        layer = rows[:, low] * (1 - share) + rows[:, (low + 1) % cells] * share
        total += layer * 2.0 ** (-falloff * np.log2(cells))
        cells *= 2
    return (total - total.min()) / np.ptp(total)


def writing(rng: np.random.Generator, size: int) -> np.ndarray:
    """Lines of small marks with gaps, like print, 1 on 0, `[row, column]`."""
    page = np.zeros((size, size))
    line = int(rng.integers(4, 13))
    for top in range(line // 2, size - line, line):
        marks = rng.random((line - max(1, line // 3), size)) < 0.55
        words = np.repeat(rng.random(size // (2 * line) + 1) < 0.8, 2 * line)[:size]
        page[top : top + len(marks)] = marks * words
    return page


def picture(rng: np.random.Generator, size: int = 128) -> np.ndarray:
    """Of any frequency and contrast: clouds, grain, print, boards up to the finest, `[row, column, rgb]`."""
    kind = rng.integers(5)
    first, second = rng.uniform(0.02, 0.9, (2, 3))
    if kind == 0:
        shares = np.stack([fractal(rng, size, rng.uniform(0, 1.6)) for _ in range(3)], axis=-1)
        return np.clip(first + shares * (second - first), 0, 1)
    if kind == 1:
        return np.clip(rng.uniform(0.2, 0.6) + rng.uniform(0.1, 0.5) * rng.normal(size=(size, size, 3)), 0, 1)
    if kind == 2:
        share = writing(rng, size)
    elif kind == 3:
        y, x = np.mgrid[:size, :size] * 2 ** int(rng.integers(1, 7)) // size
        share = (x + y) % 2
    else:
        share = (fractal(rng, size, rng.uniform(0.5, 1.5)) > rng.uniform(0.35, 0.65)).astype(float)
    return first + share[..., None] * (second - first)

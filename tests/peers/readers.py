"""EXR files as other programs read them: OpenImageIO, OpenEXR's own Python module, and its tools."""

import json
import subprocess
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO as oiio

# The wheel's script may have lost its interpreter; the program itself is beside the module.
OIIOTOOL = Path(oiio.__file__).parent / "bin" / "oiiotool"

Channels = dict[str, np.ndarray]


def read_openexr(path: Path, part: int = 0) -> tuple[Channels, dict[str, object]]:
    """Channels `[y, x]` by name, and the attributes."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        pixels = {name: channel.pixels for name, channel in file.channels(part).items()}
        return pixels, dict(file.header(part))


def read_oiio(path: Path) -> tuple[Channels, oiio.ImageSpec]:
    """Channels `[y, x]` by name, and the header, of the first part."""
    file = oiio.ImageInput.open(str(path))
    assert file is not None, oiio.geterror()
    spec = file.spec()
    channels = {}
    for i, name in enumerate(spec.channelnames):
        # One by one, or channels of different types would all become floats.
        pixels = file.read_image(0, 0, i, i + 1, spec.channelformat(i))
        assert pixels is not None, file.geterror()
        channels[name] = np.ascontiguousarray(pixels[:, :, 0])
    file.close()
    return channels, spec


def read_openexr_tools(path: Path) -> tuple[str, Channels]:
    """What `exrheader` prints, and the channels of a copy in tiles by `exrmaketiled`."""
    copy = path.with_suffix(".tiled.exr")
    command = ["exrheader", path]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    subprocess.run(["exrmaketiled", path, copy], capture_output=True, check=True)
    return listed, read_openexr(copy)[0]


def same_bits(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether type, shape and every bit agree."""
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def read_dataset(path: Path) -> tuple[np.ndarray, dict[str, str]]:
    """The tensor `[run, term, lane]` of a dataset, and its metadata."""
    data = path.read_bytes()
    length = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + length])
    numbers = np.frombuffer(data, "<f4", offset=8 + length)
    return numbers.reshape(header["sequences"]["shape"]), header["__metadata__"]


def write_openexr(path: Path, channels: Channels, **header: object) -> None:
    """Writes a file of one part with OpenEXR's Python module."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | header
    # The module replaces the values of the dictionary.
    with OpenEXR.File(header, dict(channels)) as file:
        file.write(str(path))

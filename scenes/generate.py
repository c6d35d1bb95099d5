"""Writes the scenes that come from formulas.

    python3 scenes/generate.py                  rewrites the committed ones in place
    python3 scenes/generate.py --check          compares them with the committed files
    python3 scenes/generate.py big DIRECTORY    writes the big one, which is not committed

scenes/README.md says what each is for.
"""

import argparse
import sys
from pathlib import Path

from generator.catalogue import COMMITTED, Scene, sphereflake

HERE = Path(__file__).parent


def write(scene: Scene, folder: Path) -> None:
    """Writes the files of a scene into a folder, which need not exist."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in scene.files().items():
        (folder / name).write_text(text, encoding="ascii", newline="\n")


def differing(scene: Scene, folder: Path) -> list[Path]:
    """The files that are missing or are not what would be written."""
    return [
        folder / name
        for name, text in scene.files().items()
        if not (folder / name).is_file() or (folder / name).read_bytes() != text.encode("ascii")
    ]


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="write nothing; exit with 1 on a difference")
    commands = parser.add_subparsers(title="other scenes")
    big = commands.add_parser("big", help="write a sphereflake of 262,404 triangles")
    big.add_argument("directory", type=Path)
    arguments = parser.parse_args()

    if "directory" in arguments:
        if arguments.check:
            parser.error("the big scene is not committed; there is nothing to --check")
        write(sphereflake(), arguments.directory)
        return 0

    scenes = [make() for make in COMMITTED]
    if arguments.check:
        paths = [path for scene in scenes for path in differing(scene, HERE / scene.name)]
        for path in paths:
            print(f"{path} is not what generate.py writes", file=sys.stderr)
        return 1 if paths else 0
    for scene in scenes:
        write(scene, HERE / scene.name)
    return 0


if __name__ == "__main__":
    sys.exit(main())

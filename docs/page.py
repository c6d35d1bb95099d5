"""Tables in the pages of this folder: each stands between `<!-- NAME -->` and `<!-- end of NAME -->`."""

import sys
from collections.abc import Callable
from pathlib import Path


def filled(page: Path, blocks: dict[str, list[str]]) -> str:
    """The text of a page, with these lines in its blocks."""
    text = page.read_text(encoding="utf-8")
    for name, lines in blocks.items():
        begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
        before, _, rest = text.partition(begin)
        _, _, after = rest.partition(end)
        if not after:
            sys.exit(f"{page}: lacks the block {name}")
        text = before + begin + "\n".join(lines) + "\n" + end + after
    return text


def command(
    argv: list[str],
    script: str,
    doc: str,
    page: Path,
    measure: Callable[[Path], None],
    blocks: Callable[[], dict[str, list[str]]],
) -> int:
    """Does what `--measure FOLDER`, `--check` or no argument asks of a script: the exit code."""
    if argv[:1] == ["--measure"] and len(argv) == 2:
        measure(Path(argv[1]))
        return 0
    if argv not in ([], ["--check"]):
        print(doc)
        return 2
    return fill(page, blocks(), script, check=argv == ["--check"])


def fill(page: Path, blocks: dict[str, list[str]], script: str, check: bool) -> int:
    """Writes these lines into the blocks of a page, or says whether they are there: the exit code."""
    new = filled(page, blocks)
    if check and new != page.read_text(encoding="utf-8"):
        print(f"{page} differs from its tables; run {Path(script).name}", file=sys.stderr)
        return 1
    if not check:
        page.write_text(new, encoding="utf-8")
    return 0

"""Makes the charts' font out of Liberation Sans: see README.md."""

import sys
from pathlib import Path

from fontTools import subset

RANGES = [
    (0x20, 0x7E),  # ASCII
    (0xA0, 0x17F),  # Latin
    (0x370, 0x45F),  # Greek and Cyrillic
    (0x2010, 0x2026),  # dashes, quotation marks, …
    (0x2070, 0x209F),  # superscripts and subscripts
]
SINGLE = [0x2190, 0x2192, 0x2202, 0x2212, 0x221A, 0x221E, 0x2248, 0x2260, 0x2264, 0x2265]
NAMES = [0, 1, 2, 3, 4, 5, 6, 13, 14]


def main() -> None:
    for style in ("Regular", "Bold"):
        options = subset.Options(hinting=False, layout_features=[], name_IDs=NAMES)
        options.notdef_outline = True
        options.drop_tables += ["GDEF", "GPOS", "GSUB", "kern", "gasp"]
        path = Path(sys.argv[1]) / f"LiberationSans-{style}.ttf"
        font = subset.load_font(str(path), options)
        subsetter = subset.Subsetter(options)
        letters = [code for first, last in RANGES for code in range(first, last + 1)]
        subsetter.populate(unicodes=letters + SINGLE)
        subsetter.subset(font)
        for name in font["name"].names:
            if name.nameID in (1, 3, 4):
                name.string = "Chart Sans"
            elif name.nameID == 6:
                name.string = f"ChartSans-{style}"
        font.save(Path(__file__).parent / f"ChartSans-{style}.ttf")


main()

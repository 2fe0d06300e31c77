"""Klosowski and Silva, IEEE TVCG 7(4), 2001: what is printed there."""

from __future__ import annotations

from visref.papers.published import Printed, PrintedRange, PrintedWords

SECTION_1, SECTION_4 = "section 1", "section 4"

FEWER_A_LEAF = Printed(5_000, SECTION_4, "each leaf contained fewer triangles than")
LEAVES = Printed(1_429, SECTION_4, "octree leaf cells created")
FRAMES = Printed(500, SECTION_4, "500-frame path")
MANY_TRIANGLES = PrintedWords("over one million triangles", SECTION_4)

# Budget: average rounds of queries a frame, triangles beyond the budget's, and frames a second,
# extrapolated for a Kayak.
TABLE_3 = {
    budget: tuple(
        Printed(value, "Table 3", f"budget {budget:,}, {column}")
        for column, value in zip(
            ("# EXT tests", "avg. extra triangles", "frame rate (Hz)"), values, strict=True
        )
    )
    for budget, values in {
        1_000: (4.688, 16_844, 22.7),
        10_000: (3.376, 10_978, 22.2),
        25_000: (2.426, 5_641, 18.9),
        50_000: (1.908, 2_796, 13.9),
        75_000: (1.630, 1_770, 10.4),
        100_000: (1.372, 1_247, 8.6),
    }.items()
}

# Microseconds to transfer and to scan an image of 64 x 64 and 512 x 512 pixels, by machine; and
# for the histogram of one, in one number.
TABLE_2 = {
    machine: {
        side: tuple(
            Printed(us, "Table 2", f"{machine}, {side} squared, {what}")
            for what, us in zip(("transfer", "scan"), both, strict=True)
        )
        for side, both in by_side.items()
    }
    for machine, by_side in {
        "Octane": {64: (217, 30), 512: (4_483, 2_300)},
        "Onyx": {64: (564, 20), 512: (7_733, 1_000)},
        "Kayak": {64: (375, 47), 512: (11_250, 3_430)},
    }.items()
}
HISTOGRAM_US = {
    machine: {
        side: Printed(us, SECTION_4, f"histogram of {side} x {side}, {machine}, microseconds")
        for side, us in by_side.items()
    }
    for machine, by_side in {
        "Octane": {64: 800, 512: 34_000},
        "Onyx": {64: 690, 512: 13_500},
    }.items()
}
QUERY_US = PrintedRange(  # one HP query, waited for
    Printed(100, SECTION_4, "visibility queries on the Kayak, from, microseconds"),
    Printed(1_000, SECTION_4, "visibility queries on the Kayak, to, microseconds"),
)

DEPTH_COMPLEXITY = (
    Printed(26.70, SECTION_4, "skyscraper, VF-BF, z-tests a pixel"),
    Printed(7.97, SECTION_4, "skyscraper, cPLP, z-tests a pixel"),
)

# Seconds a frame, at the fastest budget.
SECONDS = {
    (machine, way): Printed(value, SECTION_4, f"seconds a frame, {way}, {machine}")
    for (machine, way), value in {
        ("Octane", "item-buffer"): 0.081,
        ("Octane", "histogram"): 0.164,
        ("Octane", "VF-BF"): 0.975,
        ("Onyx", "item-buffer"): 0.113,
        ("Onyx", "histogram"): 0.178,
        ("Kayak", "item-buffer"): 0.864,
        ("Kayak", "HP"): 0.157,
    }.items()
}
FASTER_THAN_VF_BF = {
    "item-buffer": Printed(12, SECTION_4, "cPLP-IB faster than VF-BF, times"),
    "histogram": Printed(6, SECTION_4, "cPLP-HG faster than VF-BF, times"),
}
HP_HZ = Printed(18, SECTION_4, "frame rate of cPLP-HP, Hz")
EXT_OVER_HP = Printed(28, SECTION_4, "cPLP-EXT versus cPLP-HP, improvement of %", per=100)

# A city of 500,000 triangles, on a tenth of them: visible triangles found, on average, and wrong
# pixels at worst.
PLP_FINDS = Printed(90, SECTION_1, "% of the visible triangles found on average", per=100)
PLP_DRAWS = Printed(10, SECTION_1, "% of the total geometry rendered", per=100)
PLP_WRONG = Printed(4, SECTION_1, "% of the pixels generated incorrectly, worst case", per=100)

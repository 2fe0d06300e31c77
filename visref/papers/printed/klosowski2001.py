"""Klosowski and Silva, IEEE TVCG 7(4), 2001: what is printed there."""

from __future__ import annotations

from typing import NamedTuple

from visref.papers.published import Printed, PrintedRange, PrintedWords

SECTION_1, SECTION_4 = "section 1", "section 4"

FEWER_A_LEAF = Printed(5_000, SECTION_4, "each leaf contained fewer triangles than")
LEAVES = Printed(1_429, SECTION_4, "octree leaf cells created")
FRAMES = Printed(500, SECTION_4, "500-frame path")
MANY_TRIANGLES = PrintedWords("over one million triangles", SECTION_4)


class AtBudget(NamedTuple):
    """A row of Table 3: seconds of PLP alone, rounds of queries a frame, triangles beyond the
    budget's, seconds a frame, and frames a second. The last two are extrapolated for a Kayak."""

    plp_s: Printed
    tests: Printed
    extra: Printed
    average_s: Printed
    hz: Printed


TABLE_3 = {
    budget: AtBudget(
        *(
            Printed(value, "Table 3", f"budget {budget:,}, {column}")
            for column, value in zip(
                (
                    "PLP Time (s)",
                    "# EXT tests",
                    "avg. extra triangles",
                    "Average Time (s)",
                    "frame rate (Hz)",
                ),
                values,
                strict=True,
            )
        )
    )
    for budget, values in {
        1_000: (0.019, 4.688, 16_844, 0.044, 22.7),
        10_000: (0.028, 3.376, 10_978, 0.045, 22.2),
        25_000: (0.043, 2.426, 5_641, 0.053, 18.9),
        50_000: (0.066, 1.908, 2_796, 0.072, 13.9),
        75_000: (0.091, 1.630, 1_770, 0.096, 10.4),
        100_000: (0.112, 1.372, 1_247, 0.116, 8.6),
    }.items()
}

# Seconds before the first frame: in all, to read the model, and for all that comes after.
PREPROCESSING_S = {
    machine: tuple(
        Printed(value, SECTION_4, f"preprocessing on the {machine}, {what}, seconds")
        for what, value in zip(
            ("in all", "reading in the model", "octree, assignment, solidity"), values, strict=True
        )
    )
    for machine, values in {
        "Octane": (76, 42, 34),
        "Onyx": (128, 64, 64),
        "Kayak": (90, 56, 34),
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
OCTANE_PLP_S = Printed(0.064, SECTION_4, "seconds occupied by the initial PLP algorithm, Octane")
EXT_HZ = Printed(23, SECTION_4, "frame rate of cPLP-EXT, Hz, potentially")
HP_HZ = Printed(18, SECTION_4, "frame rate of cPLP-HP, Hz")
EXT_OVER_HP = Printed(28, SECTION_4, "cPLP-EXT versus cPLP-HP, improvement of %", per=100)

# A city of 500,000 triangles, on a tenth of them: visible triangles found, on average, and wrong
# pixels at worst.
PLP_FINDS = Printed(90, SECTION_1, "% of the visible triangles found on average", per=100)
PLP_DRAWS = Printed(10, SECTION_1, "% of the total geometry rendered", per=100)
PLP_WRONG = Printed(4, SECTION_1, "% of the pixels generated incorrectly, worst case", per=100)

"""Décoret, Computer Graphics Forum 24(3), 2005: what is printed there."""

from __future__ import annotations

from visref.papers.published import Printed, ratio_of

# Table 1: levels and milliseconds by resolution.
LEVELS: dict[tuple[int, int], tuple[Printed, Printed]] = {
    size: (
        Printed(levels, "Table 1", f"{name}, nb levels"),
        Printed(ms, "Table 1", f"{name}, time"),
    )
    for size, name, levels, ms in (
        ((256, 256), "256 squared", 8, 2),
        ((512, 512), "512 squared", 9, 8),
        ((640, 480), "640 x 480", 10, 10),
        ((1024, 1024), "1024 squared", 10, 31),
    )
}

# Table 2: depth comparisons a frame.
DEPTH_TESTS = {
    "occlusion queries, hierarchy": Printed(1_100_000, "Table 2", "OQ w/ hier."),
    "occlusion queries": Printed(200_000, "Table 2", "OQ"),
    "N-buffer, hierarchy": Printed(350, "Table 2", "NB w/ hier."),
    "N-buffer": Printed(500, "Table 2", "NB"),
}
TESTS_A_SPRITE = Printed(256, "section 4.3", "depth tests for N particles, rasterised: 256N")
FEWER_TESTS = Printed(256, "section 4.3", "256 times less")
LOOKUPS_A_SPRITE = ratio_of(TESTS_A_SPRITE, FEWER_TESTS)
FRAGMENTS = (  # the city: without and with clamping
    Printed(20, "section 4.4", "city, fill rate without clamping, M pixels", times=1e6),
    Printed(512_000, "section 4.4", "city, pixels with clamping"),
)
CLAMPED_SHARE = Printed(2.5, "section 4.4", "city; the same ratio for the terrain, %", per=100)
SIMPLE_SHARE = Printed(20, "section 4.4", "other simpler scenes, average ratio, %", per=100)
CULLED_HZ = Printed(3, "section 4.3", "frame rate with culling, Hz")
PLAIN_HZ = Printed(100, "section 4.3", "without culling, Hz")

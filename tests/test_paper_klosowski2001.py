"""The paper's published numbers, and the lines that stand beside them."""

import itertools

from visref.papers.klosowski2001 import TABLE_3, Walk, depth_complexity, specs, table_3
from visref.registry import make_culler


def test_published_table_falls_with_the_budget():
    rows = [TABLE_3[budget] for budget in sorted(TABLE_3)]
    for (rounds, extra), (fewer, less) in itertools.pairwise(rows):
        assert fewer < rounds
        assert less < extra


def test_table_3_averages_rounds_and_subtracts_the_estimate():
    conservative = Walk([{"iterations": 2, "triangles_drawn": 900},
                         {"iterations": 3, "triangles_drawn": 1300}])  # fmt: skip
    alone = Walk([{"triangles_drawn": 800}, {"triangles_drawn": 1000}])
    assert table_3({1_000: (conservative, alone)}) == [
        ("Table 3: tests, budget 1,000", "2.500", "4.688"),
        ("Table 3: extra triangles, budget 1,000", "200", "16,844"),
    ]


def test_depth_complexity_counts_the_queries_apart():
    lines = depth_complexity(
        Walk([{"depth_tests": 4000}]), Walk([{"depth_tests": 1500, "query_fragments": 500}]), 100
    )
    assert [here for _, here, _ in lines] == ["40.00", "10.00", "5.00", "4.00", "2.67"]
    assert lines[3][2] == "3.35"


def test_specs_name_cullers_that_exist():
    for conservative, alone in specs("item-buffer").values():
        for spec in (conservative, alone):
            made = make_culler(spec)
            assert f"budget={made.budget}" in spec

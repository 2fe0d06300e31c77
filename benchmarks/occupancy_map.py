"""The occupancy map on this machine: a lookup's and a query's cost."""

from __future__ import annotations

from visref_experiments.occupancy_map import latency, lookup, query_in_triangles

TITLE = "Occupancy map (Staneker 2003): lookups and queries; `visref tables` has the rest"


def run() -> list[dict[str, str]]:
    maps, queries, triangles = (
        measure(None, None) for measure in (lookup, latency, query_in_triangles)
    )
    rows = [
        (f"lookup of {tiles} x {tiles} tiles", f"{1e6 * ms:.1f} ns")
        for tiles, ms in zip(maps["tiles"], maps["lookup_ms"], strict=True)
    ]
    small = queries["sizes_px"][0]
    rows += [
        (f"query of {small} x {small} px, {way}", f"{1e3 * ms:.1f} µs each")
        for way, ms in queries["each_ms"].items()
    ]
    sizes = zip(queries["sizes_px"], queries["unculled_ms"], queries["culled_ms"], strict=True)
    rows += [
        (f"query of {px} x {px} px, waited for",
         f"{1e3 * both:.0f} µs; back faces culled {1e3 * front:.0f} µs ({front / both:.2f})")
        for px, both, front in sizes
    ]  # fmt: skip
    share = triangles["query_ms"] / triangles["triangle_ms"]
    rows.append(("a query, in triangles of 25 px", f"{share:.0f}"))
    return [dict(zip(("measured", "here"), row, strict=True)) for row in rows]

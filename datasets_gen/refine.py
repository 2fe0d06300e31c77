"""Exact numbers of triangles: edges are halved until there are as many as asked."""

from __future__ import annotations

import numpy as np

from visref_datasets_gen.shapes import Soup


def welded(soup: Soup) -> Soup:
    """The soup with one vertex for each position, in order of x, then y, then z."""
    # What `np.unique` of rows gives; it sorts them as records, which takes four times as long.
    order = np.lexsort(soup[0].T[::-1])
    ordered = soup[0][order]
    fresh = np.ones(len(ordered), np.bool_)
    fresh[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    index = np.empty(len(ordered), np.int64)
    index[order] = np.cumsum(fresh) - 1
    return ordered[fresh], index[soup[1]]


def split_to(soup: Soup, count: int) -> Soup:
    """Halve the longest edges, with all triangles at each, until there are `count` triangles.

    A closed surface stays closed, and gains triangles in pairs; only an edge of an open border
    adds a single one. Raises ValueError if there is no edge left that would serve.
    """
    while len(soup[1]) < count:
        before = len(soup[1])
        soup = _split_once(soup, count)
        if len(soup[1]) == before:
            raise ValueError(f"no edge makes {count} triangles of {before}")
    return soup


def _split_once(soup: Soup, count: int) -> Soup:
    """One pass, in which a triangle is halved at most once."""
    vertices, triangles = soup
    missing = count - len(triangles)
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    keys = sides[:, 0] * len(vertices) + sides[:, 1]
    unique, index, users = np.unique(keys, return_inverse=True, return_counts=True)
    edges = np.stack([unique // len(vertices), unique % len(vertices)], axis=1)
    owners = np.argsort(index.reshape(-1), kind="stable") // 3
    starts = np.cumsum(users) - users
    length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    border_first = np.lexsort((-length, users if missing % 2 else -users))
    taken = np.zeros(len(triangles), np.bool_)
    chosen = []
    for edge in border_first.tolist():
        here = owners[starts[edge] : starts[edge] + users[edge]]
        if missing == 0:
            break
        if len(here) > missing or (len(here) % 2) != missing % 2 or taken[here].any():
            continue
        taken[here] = True
        chosen.append(edge)
        missing -= len(here)
    if not chosen:
        return soup
    halved = np.concatenate([owners[starts[k] : starts[k] + users[k]] for k in chosen])
    ends = np.repeat(edges[chosen], users[chosen], axis=0)
    new = np.repeat(len(vertices) + np.arange(len(chosen)), users[chosen])[:, None]
    corners = triangles[halved]
    other = np.where(corners == ends[:, :1], new, corners)
    triangles = triangles.copy()
    triangles[halved] = np.where(corners == ends[:, 1:], new, corners)
    middle = vertices[edges[chosen]].mean(axis=1)
    return np.concatenate([vertices, middle]), np.concatenate([triangles, other])

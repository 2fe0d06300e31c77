"""Measurements behind the papers' tables that are no judged run: `measure(scene, path) -> JSON`."""

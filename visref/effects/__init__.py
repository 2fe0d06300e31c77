"""Judging effects that draw no objects: particles and shadows, by their images.

A culler's promise is about a drawn set, and `visref.judging` holds it to that. An effect ends in
an image of whole numbers instead: how many sprites show at a sample, whether it is in shadow.

What is drawn stands in `light`, `sprites` and `solid` (the opaque triangles of a scene, seen from
both sides: what hides, casts and receives for certain); a method under test sees these alone.
What judges it stands apart: `images` compares such an image with the same effect's unculled one
and with ray-cast truth; `sprite_truth` and `shadow_truth` are that truth; `surfaces` says what a
rasteriser may make of a sample.
"""

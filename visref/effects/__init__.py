"""Judging effects that draw no objects: particles and shadows, by their images.

A culler's promise is about a drawn set, and `visref.judging` holds it to that. An effect ends in
an image of whole numbers instead: how many sprites show at a sample, whether it is in shadow.
`images` compares such an image with the same effect's unculled one and with ray-cast truth;
`sprites` and `shadows` are that truth; `surfaces` says what a rasteriser may make of a sample.

Effects stand on what hides and receives for certain: `solid` leaves the opaque triangles of a
scene, seen from both sides.
"""

from visref.effects.solid import solid

__all__ = ["solid"]

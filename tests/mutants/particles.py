"""Culled particles with one step broken. They draw no set of objects: the verdict is that of the
image protocol."""

from __future__ import annotations

from tests.mutants.harness import Suite, image_check, mutant
from tests.support.effect_scenes import particle_verdict, snowfall
from tests.support.shader_edits import edited
from visref_culling.gl import device
from visref_culling.n_buffer.gpu import NBufferTexture
from visref_culling.n_buffer.particles import Particles

SUITE = Suite(
    {},
    says=("violation",),
    checks=[
        image_check(
            "snowfall",
            lambda make: particle_verdict(*snowfall(1), make),
            lambda verdict: verdict.lost,
        ),
        image_check(
            "odd sizes",
            lambda make: particle_verdict(*snowfall(1, side_px=12), make),
            lambda verdict: verdict.lost,
        ),
    ],
)
PARTICLES = (SUITE.method("particles", Particles),)


class EditedParticles(Particles):
    """Its vertex shader with some changes."""

    changes: tuple[tuple[str, str], ...] = ()

    def load_program(self):
        return self.device.context.program(
            vertex_shader=edited("particle.vert", *self.changes),
            geometry_shader=device.shader_source("particle.geom"),
            fragment_shader=device.shader_source("plain.frag"),
        )


@mutant("P", of=PARTICLES, caught_by="snowfall")
class SquareRoundedInward(EditedParticles):
    """A row and a column of pixels less on each side."""

    changes = (
        ("max(corner_px, ivec2(0))", "max(corner_px + 1, ivec2(0))"),
        ("image_px) - 1);", "image_px) - 2);"),
    )


@mutant("P", of=PARTICLES, caught_by="snowfall")
class SquareOnePixelShort(EditedParticles):
    """The last row and column left out."""

    changes = (("image_px) - 1);", "image_px) - 2);"),)


@mutant("P", of=PARTICLES, caught_by="snowfall")
class CentreAlone(EditedParticles):
    """Only the pixel of the centre is tested: popping at silhouettes, as the paper warns."""

    changes = (("n_buffer_one(r)", "n_buffer_one((r + r.zwxy) / 2)"),)


@mutant("P", of=PARTICLES, caught_by="snowfall")
class LevelTooSmall(EditedParticles):
    """A level below the one whose squares hold the sprite."""

    changes = (("n_buffer_one(r)", "n_buffer_square(r.xy, findMSB(r.z - r.x + 1) - 1)"),)


@mutant("P", of=PARTICLES, caught_by="snowfall")
class SquareUnclipped(EditedParticles):
    """The square starts outside the image, where no texel is."""

    changes = (("max(corner_px, ivec2(0))", "corner_px"),)


@mutant("P", of=PARTICLES, caught_by="snowfall")
class RowsFromTheBottom(EditedParticles):
    """The lookup takes rows from the bottom."""

    changes = (
        (
            "n_buffer_one(r)",
            "n_buffer_one(ivec4(r.x, image_px.y - 1 - r.w, r.z, image_px.y - 1 - r.y))",
        ),
    )


@mutant("P", of=PARTICLES, caught_by="snowfall")
class FarSideOfTheSprite(Particles):
    """As if the sprite lay a little farther than it does."""

    def depth_shift(self, view):
        return -(2.0**-9)


@mutant("P", of=PARTICLES, caught_by="snowfall")
class NearestDepthOfTheSquare(Particles):
    """Minimum for maximum."""

    def make_levels(self, width, height):
        return NBufferTexture(self.device, width, height, farthest=False)


@mutant("P", of=PARTICLES, caught_by="snowfall")
class DepthOfTheFrameBefore(Particles):
    """The N-buffer is built once, and kept."""

    def build(self, target):
        if self.levels is None:
            super().build(target)


@mutant("P", of=PARTICLES, caught_by="odd sizes")
class OneSquareOfHalfTheSize(EditedParticles):
    """The first of the four squares alone."""

    changes = (("n_buffer_four(r)", "n_buffer_square(r.xy, n_buffer_level(r.z - r.x + 1) - 1)"),)


@mutant("P", of=PARTICLES, caught_by="odd sizes")
class LevelsBuiltTooLow(Particles):
    """The levels end one below the four squares'."""

    def top_level(self):
        return super().top_level() - 1

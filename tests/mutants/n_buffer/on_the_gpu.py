"""N-buffer culling on the GPU with its shaders edited."""

from __future__ import annotations

from typing import Any

from tests.mutants.harness import mutant
from tests.mutants.n_buffer.methods import ACROSS, GPU, GPU_ONE, GPUS, LEANING, PIERCED
from tests.support.shader_edits import edited
from visref_culling.n_buffer.gpu import NBufferTexture
from visref_culling.n_buffer.gpu_cull import SHADER, GpuCull


def on_the_gpu(name: str, about: str, *edits: tuple[str, str], build: str = "") -> type:
    """A culler's step that edits the GPU's shader, or with `build` the one that builds levels."""

    class Built(NBufferTexture):
        def shader(self, name: str) -> Any:
            if name != build:
                return super().shader(name)
            return self.device.context.compute_shader(edited(build, *edits))

    class Edited(GpuCull):
        def load(self) -> Any:
            if build:
                return super().load()
            return self.device.context.compute_shader(edited(SHADER, *edits))

        texture = Built

    return type(name, (), {"__doc__": about, "gpu_cull": Edited})


_LOOK = "texelFetch(n_buffer, ivec3(start, level), 0).x"
_EDITS: dict[str, tuple[str, str, str, list[tuple[str, str]], str]] = {
    "G1": ("CornersBehindTheEyeOnTheGPU",
           "Corners are projected whatever their sign, and depth is taken from the farthest.",
           ACROSS,
           [("if (nearest <= growth.w) {\n        return true;\n    }", ""),
            ("double nearest = least(depth_row.xyz);",
             "double nearest = least(depth_row.xyz);\n"
             "    nearest = nearest > growth.w ? nearest : most(depth_row.xyz);")], ""),
    "G4": ("LastColumnLeftOutOnTheGPU", "The rectangle ends before its last column and row.",
           PIERCED,
           [("return ivec4(ivec2(first), ivec2(last));",
             "return ivec4(ivec2(first), max(ivec2(last) - 1, min(ivec2(first), ivec2(last))));")],
           ""),
    "G5": ("EuclideanDistanceOnTheGPU", "The distance of the nearest point is compared.", PIERCED,
           [("double depth = window_depth(nearest);",
             "nearest = length(max(max(low, -high), dvec3(0.0lf)));\n"
             "    double depth = window_depth(nearest);")], ""),
    "G6": ("DepthOfTheCentreOnTheGPU", "The box's centre stands for its nearest point.", LEANING,
           [("double depth = window_depth(nearest);",
             "nearest = 0.5lf * dot(depth_row.xyz, low + high);\n"
             "    double depth = window_depth(nearest);")], ""),
    "G7": ("SixteenBitsOnTheGPU", "Depth enters the levels in 16 bits, rounded to nearest.",
           PIERCED,
           [("vec4(depth)", "vec4(round(depth * 65535.0) / 65535.0)")], "n_buffer_base.comp"),
    "G8": ("StrictAndUnshiftedOnTheGPU", "A box at its own object's depth is hidden.",
           "huge_depth_range",
           [("0.5lf * (ndc - to_window.z) + 0.5lf", "0.5lf * ndc + 0.5lf"),
            ("return depth <= double(farthest);", "return float(depth) < farthest;")], ""),
    "U1": ("NearestForFarthestOnTheGPU", "A level holds the nearest depth.", PIERCED,
           [("farthest ? max(depth, other)", "!farthest ? max(depth, other)")],
           "n_buffer_level.comp"),
    "U2": ("DifferenceForCountOnTheGPU", "Squares for x1 - x0 pixels, not one more.", PIERCED,
           [("ivec2 size = r.zw - r.xy + 1;", "ivec2 size = max(r.zw - r.xy, 1);")], ""),
    "U3": ("OffsetTooFarOnTheGPU", "A level is joined from pixels a whole square apart.", PIERCED,
           [("1 << (level - 1)", "1 << level")], "n_buffer_level.comp"),
    "U5": ("LevelRoundedDownOnTheGPU", "The level is rounded down.", PIERCED,
           [("findMSB(n - 1) + 1", "findMSB(n - 1)")], ""),
    "U6": ("BottomForTopOnTheGPU", "Level 0 is copied with the first row at the bottom.", PIERCED,
           [("size.y - 1 - at.y", "at.y")], "n_buffer_base.comp"),
    "U7": ("UnclippedQueryOnTheGPU", "The rectangle is not clipped; outside is 0.", PIERCED,
           [("floor(min(max(first, dvec2(0.0lf)), size))", "floor(first)"),
            ("floor(max(min(last, size - 1.0lf), dvec2(-1.0lf)))", "floor(last)"),
            (_LOOK, "(any(lessThan(start, ivec2(0))) ? 0.0 : " + _LOOK + ")")], ""),
    "U8": ("OneTexelOffOnTheGPU", "The pixel before is looked up.", PIERCED,
           [(_LOOK, "texelFetch(n_buffer, ivec3(max(start - 1, 0), level), 0).x")], ""),
    "U11": ("HalfFloatLevelsOnTheGPU", "Levels are kept in 16-bit floating point.", PIERCED,
            [("vec4(depth)", "vec4(unpackHalf2x16(packHalf2x16(vec2(depth))).x)")],
            "n_buffer_base.comp"),
}  # fmt: skip
for id_, (name_, about_, caught_, edits_, build_) in _EDITS.items():
    mutant(id_, of=GPUS, caught_by=caught_)(on_the_gpu(name_, about_, *edits_, build=build_))
mutant("U4", of=(GPU,), caught_by=PIERCED)(
    on_the_gpu(
        "SecondSquareShortOnTheGPU",
        "The squares that end at the rectangle's last column start one pixel too early.",
        ("ivec2 last = max(r.zw - side + 1, r.xy);", "ivec2 last = max(r.zw - side, r.xy);"),
    )
)
mutant("U9", of=(GPU_ONE,), caught_by=PIERCED)(
    on_the_gpu(
        "TopLevelMissingOnTheGPU",
        "Levels end with the largest square that fits the image's longer side.",
        ("n_buffer_square(r.xy, n_buffer_level(max(size.x, size.y)))",
         "n_buffer_square(r.xy, min(n_buffer_level(max(size.x, size.y)), 6))"),
    )
)  # fmt: skip


@mutant("U10", of=GPUS, caught_by="jump_cuts")
@mutant("G11", of=GPUS, caught_by="jump_cuts")
class DepthOfTheLastFrameOnTheGPU:
    """The levels of the frame before are looked up with this frame's camera."""

    class gpu_cull(GpuCull):
        class texture(NBufferTexture):
            before = None

            def build(self, target, *, levels=None):
                super().build(target, levels=levels)
                made = self.read().tobytes()
                if self.before is not None:
                    self.texture.write(self.before)
                self.before = made


# The wasteful edits: what leaves the image joins the farthest depth, or the other edge.
mutant("W12", of=GPUS, contract="what_one_square_hides_is_not_drawn")(
    on_the_gpu(
        "BorderOfOneOnTheGPU",
        "Outside the image lies the farthest depth.",
        ("return depth;\n    }", "return 1.0;\n    }"),
        build="n_buffer_level.comp",
    )
)
mutant("W13", of=GPUS, contract="what_one_square_hides_is_not_drawn")(
    on_the_gpu(
        "RepeatWrapOnTheGPU",
        "Beyond the image's edge the other edge follows.",
        ("return depth;\n    }", "at = at % size;\n    }"),
        build="n_buffer_level.comp",
    )
)

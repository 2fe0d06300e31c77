"""The mutants of `tests.mutants` that a verdict convicts of lost objects, on the scenes that do.

Mutants of effects are left out: no object is lost by them, but samples of an image.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, partial

from tests.causes.fault import Fault, Input
from tests.causes.longer import longer
from tests.mutants.harness import Mutant, Suite, suites
from visref.conformance.building import Case
from visref.conformance.suite import built_case, built_of
from visref.culler import Culler

# The family of each broken step, by its class's name; `suite/name` where a method's own class of
# that name does something else.
STEPS = {
    # Of any method: boxes and their corners.
    "CornersBehindTheEye": "corners behind the eye",
    "CornersBehindTheEyeOnTheGPU": "corners behind the eye",
    "CornersBeforeNearLeftOut": "corners behind the eye",
    "QueryWithTheEyeInside": "eye inside the box",
    "AskedWithTheEyeInside": "eye inside the box",
    "TwoCornersTransformed": "two corners of eight",
    "MirroredCornersUnsorted": "box turned inside out",
    "TwoCornersProjected": "two corners of eight",
    "BoxesOfJoints": "box or sphere too small",
    "CentresAlone": "centre in the view",
    "NoCornerInView": "one corner in the view",
    "LensShiftLeftOut": "lens shift left out",
    "FrustumOfTheLastFrame": "answer a frame late, nothing moves",
    "frustum/LastRowAndColumnLeftOut": "view a pixel too small",
    # Only neighbours of visible cells are asked: past a hidden one around the eye nothing is.
    "plp/AskedWithTheEyeInside": "eye inside the first cell",
    # A cell, or a part, does not hold its triangles; a stand-in shrinks.
    "OnlyInTheCentroidsLeaf": "box or sphere too small",
    "PartsOfCentroids": "box or sphere too small",
    "LastTightBoxLeftOut": "box or sphere too small",
    # What is lost is part of the box, before the near plane.
    "CutOpenByTheNearPlane": "parts left out",
    "TriangleIdsOfTheTiledScene": "box or sphere too small",
    "AskedAtLowResolution": "box or sphere too small",
    # Rectangles.
    "LastRowAndColumnLeftOut": "rectangle too small",
    "LastColumnLeftOut": "rectangle too small",
    "LastColumnLeftOutOnTheGPU": "rectangle too small",
    "RectangleRoundedToNearest": "rectangle too small",
    "SizeRoundedToNearest": "rectangle too small",
    "SharedPartRoundedInward": "rectangle too small",
    "BoxesNotGrown": "rectangle too small",
    "DifferenceForCount": "rectangle too small",
    "DifferenceForCountOnTheGPU": "rectangle too small",
    "SecondSquareShort": "rectangle too small",
    "SecondSquareShortOnTheGPU": "rectangle too small",
    # The columns looked up are the rectangle's but for the last, and one before it.
    "OneTexelOff": "rectangle too small",
    "OneTexelOffOnTheGPU": "rectangle too small",
    "TopLevelMissing": "rectangle too small",
    "TopLevelMissingOnTheGPU": "rectangle too small",
    "SphereAboutItsCentre": "rectangle too small",
    "LevelTooFine": "squares too small",
    "LevelRoundedDown": "squares too small",
    "LevelRoundedDownOnTheGPU": "squares too small",
    "UnclippedQuery": "squares too small",
    "UnclippedQueryOnTheGPU": "squares too small",
    "OffsetTooNear": "squares too small",
    "OffsetTooFar": "some samples of the rectangle",
    "OffsetTooFarOnTheGPU": "some samples of the rectangle",
    "RectangleUpsideDown": "upside down",
    "ReadbackUpsideDown": "upside down",
    "BottomForTop": "upside down",
    "BottomForTopOnTheGPU": "upside down",
    "EdgeCellsLeftOut": "last texels left out",
    "BorderTilesLeftOut": "last texels left out",
    "LastTexelsLeftOut": "last texels left out",
    "OddRestLeftOut": "last texels left out",
    # Depths.
    "EuclideanDistance": "distance for depth",
    "EuclideanDistanceOnTheGPU": "distance for depth",
    "DepthOfTheCentre": "centre's depth",
    "DepthOfTheCentreOnTheGPU": "centre's depth",
    "ParentsWaitForTheirCentres": "centre's depth",
    "DrawListByNearest": "no depth compared",
    "DepthReadBackInBytes": "few bits",
    "DepthReadBackInSixteenBits": "few bits",
    "SixteenBitsOnTheGPU": "few bits",
    "SixteenBits": "few bits",
    "DepthInHalfFloats": "few bits",
    "DepthCopiedInBytes": "few bits",
    "HalfFloatLevels": "few bits",
    "HalfFloatLevelsOnTheGPU": "few bits",
    "StrictAndUnshifted": "own depth",
    "StrictAndUnshiftedOnTheGPU": "own depth",
    "StrictlyNearer": "own depth",
    "NearestForFarthest": "nearest of the region",
    "NearestForFarthestOnTheGPU": "nearest of the region",
    "FarthestIsNearest": "nearest of the region",
    "FullOnAnyCoveredPixel": "cell covered in part",
    "FullFromABorderQuery": "cell covered in part",
    "DepthReversed": "depth reversed",
    "LinearFilter": "neighbours averaged",
    "BilinearDepth": "neighbours averaged",
    "OneSampleForATexel": "quarter of the resolution",
    "SmallerViewport": "quarter of the resolution",
    "AnotherAspect": "other lens",
    "ResolvedMultisamples": "another point of the pixel",
    # What hides.
    "GlassOccludes": "glass solid",
    "GlassWritesDepth": "glass solid",
    "ClipPlaneIgnored": "clip plane left out",
    "DepthMaskLeftOn": "asked boxes hide",
    "SectionFiveWithLess": "asked boxes hide",
    # A cell shows only where its box is before those of all others.
    "SinglePass": "asked boxes hide",
    # What is kept.
    "DepthOfTheLastFrame": "earlier depth",
    "DepthOfTheLastFrameOnTheGPU": "earlier depth",
    "SoftwareDepthOfTheLastFrame": "earlier depth",
    "GridOfTheLastFrame": "earlier depth",
    "PyramidOfTheLastFrame": "earlier depth",
    "MatrixOfTheLastFrame": "answer a frame late, nothing moves",
    # What the pyramid of the frame before hides, looked up with this frame's boxes, stays hidden.
    "FirstAnswerIsFinal": "earlier depth",
    # All frames of its check are cuts, so that no frame before saw anything that could be drawn.
    "NoSecondPassAfterACut": "answer a frame late at cuts, nothing seen before",
    "OnlyWhatWasDrawn": "first answer kept",
    "OnlyVisibleChildren": "first answer kept",
    "AnswersNotWaitedFor": "answer a frame late",
    "AnswersOfBeforeTheCut": "answer a frame late at cuts",
    "BufferOfTheLastFrame": "earlier depth",
    "BufferAtItsOldPlace": "occluders at their old place",
    "RemovedObjectsInTheBuffer": "removed still hides",
    # What covers a tile in part hides as if it covered all of it, or as its nearest depth did.
    "DepthOfTheLast": "nearest of the region",
    "FullWithOnePixel": "cell covered in part",
    "MaskKept": "nearest of the region",
    "SecondLayerForAll": "cell covered in part",
    "WholeTilesCovered": "cell covered in part",
    "NearestInATile": "nearest of the region",
    "TilesOfTheLastFrame": "tiles of the frame before",
    # What moves.
    "BoxesAtRest": "pose at rest",
    "BoxesOfTheFrameBefore": "pose of the frame before",
    "DepthAtItsOldPlace": "occluders at their old place",
    "SoftwareDepthAtItsOldPlace": "occluders at their old place",
    "RemovedObjectsDrawn": "removed still hides",
    "RemovedObjectsInTheSoftwareBuffer": "removed still hides",
    "NoEntryForWhatAppears": "appeared unknown",
    "NoNodeForWhatAppears": "appeared unknown",
    "TightBoxesAtRest": "pose at rest",
    "InnerBoxesAtRest": "pose at rest",
    "ConesAtRest": "pose at rest",
    # What a backface cone leaves out shows its front.
    "ConesPosedLikePoints": "front for back",
    "ConesWithoutReach": "front for back",
    "MeanNormalForAll": "front for back",
    # Answers and lists.
    "ThresholdAboveOneSample": "threshold of samples",
    "ThresholdAboveOnePixel": "threshold of samples",
    "ThresholdOffByOne": "threshold of samples",
    "ResultsShiftedByOne": "answers shifted",
    "AnswerOfTheQueryBefore": "answers shifted",
    "IndicesShifted": "answers shifted",
    "UnfinishedQueryReadAsZero": "answers lost",
    "TilesInTheOrderOfTheirHalves": "answers shifted",
    "LastListNotFlushed": "answers lost",
    "DroppedAfterTheLastMap": "answers lost",
    # Two ids are one, or an id is the background's: the answers of some cells are lost.
    "FirstIdIsTheBackgrounds": "answers lost",
    "IdsAreBlended": "answers lost",
    "NotRenderedAgain": "answers lost",
    "FirstAloneShows": "answers lost",
    "QuestionsDropped": "answers lost",
    "OnlyTheFirstBoxAsked": "answers lost",
    "LastLeftOut": "list cut short",
    "StopsAtTheBudget": "list cut short",
    "EqualSizeNeighboursOnly": "traversal stops short",
    "EmptyLeavesSkipped": "traversal stops short",
    "OnlyTheNearestCell": "traversal stops short",
}

# Where a variant of a method, or its scene, makes another mistake of the same step: by the variant.
VARIANTS = {
    # Objects are asked by their own triangles, the slices of glass among them, which hide then.
    ("DepthMaskLeftOn", "three-pass-whole"): "glass solid",
    # A single square that is too small ends before the rectangle does.
    ("LevelRoundedDown", "n-buffer-one"): "rectangle too small",
    ("LevelRoundedDownOnTheGPU", "n-buffer-gpu-one"): "rectangle too small",
}


def family_of(suite: str, mutant: Mutant) -> str:
    step = mutant.culler.__name__
    own = STEPS.get(f"{suite}/{step}") or STEPS[step]
    return VARIANTS.get((step, mutant.method.name), own)


def mutants() -> Iterator[Fault]:
    """Each of them once, though it be registered under two ids."""
    seen = set()
    for module, suite in suites().items():
        short = module.removeprefix("tests.mutants.").removesuffix(".contract")
        for mutant in sorted(suite.mutants, key=str):
            step = mutant.culler.__name__
            key = short, step, mutant.method.name, mutant.caught_by
            if not issubclass(mutant.culler, Culler) or not mutant.caught_by or key in seen:
                continue
            seen.add(key)
            id_ = mutant.id.replace(" ", "-")
            yield Fault(
                f"mutant/{short}/{id_}-{step}/{mutant.method.name}",
                family_of(short, mutant),
                f"mutant/{short}/{step}",
                mutant.about,
                partial(_input, suite, mutant),
            )


def _input(suite: Suite, mutant: Mutant) -> Input:
    built = _case(suite, mutant.caught_by)
    return Input(built.scene, longer(built.scene, built.path), mutant.make())


@cache
def _case(suite: Suite, name: str) -> Case:
    made = suite.own.get(name)
    return built_case(name, 0)[0] if made is None else built_of(made, 0)

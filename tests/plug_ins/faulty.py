"""Cullers with one fault each, by the step in which it shows; `Safe` and `Misses` have none.

Written as somebody's plug-in would be: the tests copy this file into a folder of its own and run it
from there, in its own process or in the judge's.
"""

import ctypes
import os
import sys
import threading
import time
import warnings
from contextlib import suppress

import numpy as np

from visref.culler import Culler, DrawnSet, QueryStats, Raster, RasterTolerance
from visref.errors import InputError, NothingToJudge
from visref.scene import Units


class Safe(Culler):
    name = "safe"

    def prepare(self, scene):
        self.scene, self.count = scene, scene.object_count
        return scene.object_units()

    def cull(self, camera):
        return self.everything()

    def everything(self, **more):
        return DrawnSet(np.arange(self.count, dtype=np.int32), **more)


class Misses(Safe):
    """Never draws the first object."""

    def cull(self, camera):
        return DrawnSet(np.arange(1, self.count, dtype=np.int32))


# Leaving.


class LeavesInConstructor(Safe):
    def __init__(self):
        sys.exit(0)


class LeavesInPrepare(Safe):
    def prepare(self, scene):
        sys.exit(0)


class LeavesInCull(Safe):
    def cull(self, camera):
        sys.exit()


class LeavesInClose(Safe):
    def close(self):
        sys.exit(0)


class EndsInConstructor(Safe):
    def __init__(self):
        os._exit(0)


class EndsInPrepare(Safe):
    def prepare(self, scene):
        os._exit(0)


class EndsInCull(Safe):
    def cull(self, camera):
        os._exit(0)


class EndsInClose(Safe):
    def close(self):
        os._exit(0)


class Dies(Safe):
    def cull(self, camera):
        print("about to read address 0", flush=True)
        ctypes.string_at(0)


# Never coming back.


class HangsInPrepare(Safe):
    def prepare(self, scene):
        time.sleep(3600)


class HangsInCull(Safe):
    def cull(self, camera):
        time.sleep(3600)


class HangsInClose(Safe):
    def close(self):
        time.sleep(3600)


class LeavesAThread(Safe):
    def cull(self, camera):
        threading.Thread(target=time.sleep, args=(3600,)).start()
        return self.everything()


class Forks(Safe):
    def cull(self, camera):
        os.fork()
        return self.everything()


# Raising.


class RaisesInConstructor(Safe):
    def __init__(self):
        raise RuntimeError("not today")


class RaisesInputErrorInConstructor(Safe):
    def __init__(self):
        raise InputError("nobody gave an option")


class RaisesInPrepare(Safe):
    def prepare(self, scene):
        raise RuntimeError("not today")


class RaisesInputError(Safe):
    def cull(self, camera):
        raise InputError("an InputError of its own")


class RaisesNothingToJudge(Safe):
    def cull(self, camera):
        raise NothingToJudge("no GL")


class RaisesGeneratorExit(Safe):
    def cull(self, camera):
        raise GeneratorExit


class RaisesWithoutWords(Safe):
    def cull(self, camera):
        class Mute(Exception):
            def __str__(self):
                raise ValueError

        raise Mute


class RunsOutOfStack(Safe):
    def cull(self, camera):
        return self.cull(camera)


class RaisesInClose(Safe):
    def close(self):
        raise RuntimeError("not today")


# Answering what is no answer.


class NoUnits(Safe):
    def prepare(self, scene):
        super().prepare(scene)


class UnitsOfLists(Safe):
    def prepare(self, scene):
        super().prepare(scene)
        return Units([0, 1.5], ["a"])


class UnitsBeyondTheScene(Safe):
    def prepare(self, scene):
        super().prepare(scene)
        return Units(np.array([0, 1]), np.array([10**6], np.int32))


class UnitsOfTwoDimensions(Safe):
    def prepare(self, scene):
        super().prepare(scene)
        return Units(np.array([0, 2]), np.array([[0, 1], [1, 2]], np.int32))


class UnitsWithoutAName(Safe):
    def prepare(self, scene):
        units = super().prepare(scene)
        return Units(units.offsets, units.triangles, kind=7)


class DrawsNoSet(Safe):
    def cull(self, camera):
        return None


class DrawsTwice(Safe):
    def cull(self, camera):
        return DrawnSet(np.array([0, 0], np.int32))


class DrawsAGenerator(Safe):
    def cull(self, camera):
        return DrawnSet(i for i in range(3))


class DrawsBeyond(Safe):
    def cull(self, camera):
        return DrawnSet(np.array([2**64 - 1], np.uint64))


class CountsNonsense(Safe):
    def cull(self, camera):
        return self.everything(stats=QueryStats(queries=1.5))


class TakesForever(Safe):
    def cull(self, camera):
        return self.everything(stats=QueryStats(ms={"cull": float("nan")}))


class NamesAPhaseBadly(Safe):
    def cull(self, camera):
        return self.everything(stats=QueryStats(ms={"\ud800": 1.0}))


class PromisesNonsense(Safe):
    promise = "trust me"


class PromisesInAList(Safe):
    promise = ("conservative", "exact")


class CannotPromise(Safe):
    @property
    def promise(self):
        raise RuntimeError("not ready")


# Harmless in a process of its own.


class ChangesFolder(Safe):
    def cull(self, camera):
        os.chdir("/")
        return self.everything()


class MakesErrorsOfWarnings(Safe):
    def prepare(self, scene):
        np.seterr(all="raise")
        warnings.simplefilter("error")
        sys.setrecursionlimit(70)
        return super().prepare(scene)


class Prints(Safe):
    def cull(self, camera):
        print("::error file=x::hello\x1b[2J")
        print("x" * 10_000, file=sys.stderr)
        return self.everything()


class PrintsWithoutEnd(Safe):
    def cull(self, camera):
        for _ in range(5_000):
            print("again and again")
        return self.everything()


class ClosesItsOutput(Safe):
    def prepare(self, scene):
        sys.stdout.close()
        os.close(2)
        return super().prepare(scene)


class WritesIntoWhatItGets(Safe):
    """Tries to; whoever hands the arrays out decides what comes of it."""

    def prepare(self, scene):
        for array in (scene.vertices, scene.object_bounds, scene.object_of_triangle):
            with suppress(ValueError):
                array[:] = 0
            with suppress(ValueError):
                array.flags.writeable = True
                array[:] = 0
        return super().prepare(scene)


class PromisesLessLater(Safe):
    """Draws nothing, and says only then that it promised nothing."""

    def cull(self, camera):
        self.promise = "approximate"
        return DrawnSet(np.zeros(0, np.int32))


class AllocatesWithoutEnd(Safe):
    def cull(self, camera):
        held = []
        while True:
            held.append(np.ones(1 << 24))


class AnswersAlsoItself(Safe):
    """Writes to every socket that it finds, before it answers."""

    def cull(self, camera):
        for number in range(3, 1024):
            with suppress(OSError):
                os.write(number, b"\xff" * 64)
        return self.everything()


# A rasteriser of its own, whose picture the judge asks for.


class Paints(Misses):
    """Its rasteriser may lose what lies within half a pixel of an edge, and its picture shows
    nothing at all."""

    class raster(Raster):
        tolerance = RasterTolerance(0.25, None)

        def item_buffer(self, camera):
            return np.full((camera.height, camera.width), -1, np.int32)

    raster = raster()


class PaintsEverything(Misses):
    class raster(Raster):
        tolerance = RasterTolerance(0.25, None)

        def item_buffer(self, camera):
            return np.zeros((camera.height, camera.width), np.int32)

    raster = raster()


class HangsInThePicture(Misses):
    class raster(Raster):
        tolerance = RasterTolerance(0.25, None)

        def item_buffer(self, camera):
            time.sleep(3600)

    raster = raster()


class EndsInThePicture(Misses):
    class raster(Raster):
        tolerance = RasterTolerance(0.25, None)

        def item_buffer(self, camera):
            os._exit(0)

    raster = raster()


# What no rasteriser may declare: it would excuse whatever is lost.


def declaring(*tolerance: object) -> Raster:
    class Declaring(Raster):
        def item_buffer(self, camera):
            return np.full((camera.height, camera.width), -1, np.int32)

    raster = Declaring()
    raster.tolerance = RasterTolerance(*tolerance)
    return raster


class SnapsByNaN(Misses):
    raster = declaring(float("nan"))


class SnapsFar(Misses):
    raster = declaring(1e6)


class SnapsInWords(Misses):
    raster = declaring("half a pixel")


class SnapsInAList(Misses):
    raster = declaring([0.25])


class HasNoBits(Misses):
    raster = declaring(0.25, 0)


class HasBitsInWords(Misses):
    raster = declaring(0.25, "24")


class DeclaresNoTolerance(Misses):
    raster = declaring(0.25)
    del raster.tolerance

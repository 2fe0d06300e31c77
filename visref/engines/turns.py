"""How threads share what is to be done while none of them holds the interpreter's lock."""

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import intrinsic


@intrinsic
def take(typing_context: Any, counter: Any, count: Any) -> Any:
    """The number in `counter`, (1,) int64, which is `count` more from then on; whoever asks at the
    same time gets another. In kernels alone."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.atomic_rmw("add", array.data, arguments[1], "monotonic")

    return types.int64(counter, types.int64), generate

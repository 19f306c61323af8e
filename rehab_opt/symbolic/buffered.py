"""A CasADi function on arrays allocated once: 0.5-5 us a call where a plain call costs 30-70 us."""

from __future__ import annotations

import functools
import threading
import weakref
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import SharingError
from rehab_opt.symbolic.compiled import Compile, machine_code

__all__ = ["BufferedFunction", "mapped"]

Array = NDArray[np.float64]
Call = Callable[[], None]
_exchanging = threading.Lock()


class BufferedFunction:
    """Write into `inputs`, call, read from `outputs`; the next call overwrites the arrays. One thread at a time.

    Parameters
    ----------
    function : dense inputs and outputs; a column becomes an array (n,), anything else (rows, columns).
    compile : False evaluates `function` as it is. None compiles it in the background, unless `REHAB_OPT_COMPILE` says
        otherwise; until the code is ready, the virtual machine runs. "wait" waits for the code.
    inputs : arrays of the caller that serve as input buffers, by input number.

    Attributes
    ----------
    evaluate : the bare evaluation, without Python's overhead; read this attribute in each tick, since it may change.
    function : the function that is evaluated now.
    """

    __slots__ = ("__weakref__", "_around", "_buffers", "evaluate", "function", "inputs", "outputs")

    evaluate: Call

    def __init__(
        self, function: ca.Function, *, compile: Compile = False, inputs: Mapping[int, Array] = MappingProxyType({})
    ) -> None:
        own = (inputs.get(i) for i in range(function.n_in()))
        self.inputs = tuple(_dense(function.sparsity_in(i)) if each is None else each for i, each in enumerate(own))
        self.outputs = tuple(_dense(function.sparsity_out(i)) for i in range(function.n_out()))
        self._around: Callable[[Call], Call] | None = None
        self._buffers: list[Any] = []
        """Buffers, also of replaced functions, which another thread may still evaluate."""
        self._take(function)
        if compile is not False:
            quick = machine_code(function, compile=compile, ready=weakref.WeakMethod(self._take))
            if quick is not function:
                self._take(quick)

    def _take(self, function: ca.Function) -> None:
        """Evaluate `function` from now on, on the same arrays."""
        buffer, evaluate = function.buffer()
        # CasADi's stub requires a size, which a memoryview contains.
        for i, array in enumerate(self.inputs):
            buffer.set_arg(i, array.reshape(-1, order="F").data)  # type: ignore[call-arg]
        for i, array in enumerate(self.outputs):
            buffer.set_res(i, array.reshape(-1, order="F").data)  # type: ignore[call-arg]
        with _exchanging:
            self._buffers.append((buffer, function))
            self.function = function
            self.evaluate = evaluate if self._around is None else self._around(evaluate)

    def surround(self, around: Callable[[Call], Call]) -> None:
        """Replace every later evaluation by `around(evaluation)`."""
        with _exchanging:
            self._around = around
            self.evaluate = around(self.evaluate)

    def __call__(self) -> None:
        """Evaluate at `inputs`."""
        self.evaluate()

    def __reduce__(self) -> tuple[Any, ...]:
        raise SharingError("a BufferedFunction cannot be copied or pickled: make one of its function for each thread")

    def of(self, *values: ArrayLike) -> Array:
        """Copy of the first output for the given inputs, which may be anything that numpy converts."""
        for array, value in zip(self.inputs, values, strict=True):
            array[...] = value
        self.evaluate()
        return self.outputs[0].copy()


def mapped(function: ca.Function) -> Callable[[Array], Array]:
    """Evaluate a function of one column at each of M inputs (M, n); the result (M, k) is a copy of its first output."""
    at = functools.cache(lambda count: BufferedFunction(function.map(count)).of)
    return lambda columns: at(len(columns))(columns.T.squeeze()).reshape(-1, len(columns)).T


def _dense(sparsity: ca.Sparsity) -> Array:
    rows, columns = sparsity.shape
    if not sparsity.is_dense() and sparsity.numel():
        raise ValueError(f"{rows}x{columns} argument of a buffered function must be dense")
    flat = np.zeros(rows * columns)
    return flat if columns == 1 else flat.reshape((rows, columns), order="F")  # CasADi reads column by column

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
    """Write into `inputs`, call, read from `outputs`.

    The arrays are overwritten by the next call: copy what is kept. One thread at a time.

    Parameters
    ----------
    function : dense inputs and outputs; a column becomes an array (n,), anything else (rows, columns).
    compile : False evaluates `function` as it is. None compiles it in the background, or as `REHAB_OPT_COMPILE` says:
        the virtual machine answers until the code is there, from then on that does, between two calls and with the same
        numbers to rounding. "wait" waits for it.
    inputs : arrays that others own, by the number of the input that is read there.

    Attributes
    ----------
    evaluate : what a call does, without the layer of Python; ask for it anew in each tick, since it may be exchanged.
    function : what is evaluated now.
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
        """Also of what was exchanged: another thread may be inside it."""
        self._take(function)
        if compile is not False:
            quick = machine_code(function, compile=compile, ready=weakref.WeakMethod(self._take))
            if quick is not function:
                self._take(quick)

    def _take(self, function: ca.Function) -> None:
        """Evaluate this one from now on, on the same arrays."""
        buffer, evaluate = function.buffer()
        # CasADi's stub asks for a size too, which a memoryview carries.
        for i, array in enumerate(self.inputs):
            buffer.set_arg(i, array.reshape(-1, order="F").data)  # type: ignore[call-arg]
        for i, array in enumerate(self.outputs):
            buffer.set_res(i, array.reshape(-1, order="F").data)  # type: ignore[call-arg]
        with _exchanging:
            self._buffers.append((buffer, function))
            self.function = function
            self.evaluate = evaluate if self._around is None else self._around(evaluate)

    def surround(self, around: Callable[[Call], Call]) -> None:
        """Put something around every call from now on."""
        with _exchanging:
            self._around = around
            self.evaluate = around(self.evaluate)

    def __call__(self) -> None:
        """Evaluate on what stands in `inputs`."""
        self.evaluate()

    def __reduce__(self) -> tuple[Any, ...]:
        raise SharingError("a BufferedFunction cannot be copied or pickled: make one of its function for each thread")

    def of(self, *values: ArrayLike) -> Array:
        """First output, copied, for the given inputs: the convenient form, with numpy's conversions."""
        for array, value in zip(self.inputs, values, strict=True):
            array[...] = value
        self.evaluate()
        return self.outputs[0].copy()


def mapped(function: ca.Function) -> Callable[[Array], Array]:
    """First outputs (M, k), copied, of a function of one column, for inputs (M, n)."""
    at = functools.cache(lambda count: BufferedFunction(function.map(count)).of)
    return lambda columns: at(len(columns))(columns.T.squeeze()).reshape(-1, len(columns)).T


def _dense(sparsity: ca.Sparsity) -> Array:
    rows, columns = sparsity.shape
    if not sparsity.is_dense() and sparsity.numel():
        raise ValueError(f"{rows}x{columns} argument of a buffered function must be dense")
    flat = np.zeros(rows * columns)
    return flat if columns == 1 else flat.reshape((rows, columns), order="F")  # CasADi reads column by column

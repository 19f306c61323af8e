"""Fast evaluation of CasADi expressions: preallocated buffers per thread, and a cache of compiled code."""

from rehab_opt.symbolic.buffered import BufferedFunction
from rehab_opt.symbolic.compiled import Compile, compiled
from rehab_opt.symbolic.shared import Evaluator, PerThread

__all__ = ["BufferedFunction", "Compile", "Evaluator", "PerThread", "compiled"]

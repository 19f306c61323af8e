"""CasADi expressions to fast numbers: preallocated buffers and a cache of compiled code."""

from rehab_opt.symbolic.buffered import BufferedFunction
from rehab_opt.symbolic.compiled import compiled

__all__ = ["BufferedFunction", "compiled"]

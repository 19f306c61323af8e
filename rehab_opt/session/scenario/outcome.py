"""What a run of scenarios leaves behind, for its table, trace and figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.gate import Mode
from rehab_opt.field.demonstration import Demonstration
from rehab_opt.field.potential import PotentialField
from rehab_opt.session.outcome import Outcome
from rehab_opt.session.scenario.trial import Law, Trial
from rehab_opt.workspace.region import Workspace

__all__ = ["ScenarioOutcome"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ScenarioOutcome(Outcome):
    """The trials of one scenario; all places in the robot's frame.

    Parameters
    ----------
    mode : of the assistance, one for each of the paper's scenarios 1 to 5.
    comfortable, reachable : W_c and W_r.
    reference : (N, 2) [m] the path to be followed, or the points to be held, one after the other.
    demonstrated : (N, 2) [m] the helper's in W_r that the reference was mapped from; None without a map.
    fields : what the assistance follows: one, or one for each point to be held.
    shown : the demonstrations that the field was learnt from; empty where it was given.
    force_limit : [N].
    trials : by law, all of the same numbers.
    measures : by law, for each trial its numbers, the keys of `trial_measures`.
    """

    mode: Mode = field(kw_only=True)
    comfortable: Workspace = field(kw_only=True)
    reachable: Workspace = field(kw_only=True)
    reference: Array = field(kw_only=True)
    demonstrated: Array | None = field(kw_only=True)
    fields: tuple[PotentialField, ...] = field(kw_only=True)
    shown: tuple[Demonstration, ...] = field(kw_only=True, default=())
    force_limit: float = field(kw_only=True)
    trials: Mapping[Law, tuple[Trial, ...]] = field(kw_only=True)
    measures: Mapping[Law, tuple[Mapping[str, Any], ...]] = field(kw_only=True)

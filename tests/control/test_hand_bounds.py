"""Keep-out planes."""

import numpy as np

from rehab_opt import KeepOut
from tests.refusals import refuses


def test_what_is_no_plane_is_refused() -> None:
    planes = ([0, 0], [0, 0, 1]), ([0, 0, 0], [0, 0, 0]), ([np.nan, 0, 0], [0, 0, 1])
    refuses(KeepOut.through, *((plane, "normal") for plane in planes))

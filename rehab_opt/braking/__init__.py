"""Controllers that command only what can still be braked: beside `rehab_opt.control` until they have won."""

from rehab_opt.braking.pose import PoseTracker

__all__ = ["PoseTracker"]

"""Print the ranges of motion used in recorded reaches as a problem file, which compares the workspaces of these ranges.

    python examples/used_ranges.py FOLDER > used.toml     # folder with cp_dyskinetic_reach (Vanmechelen et al.)
    rehab-opt run used.toml

A reach shows the range that a person uses, not the possible range. The segment lengths are the same for everybody.
"""

import sys

import numpy as np

from rehab_opt.workspace.cp_reach import reach_groups

print('system = "workspace"\ntitle = "Range used in reaching"\n\n[arm]\nside = "left"\nhandle_tilt_deg = "any"')
for (task, group), found in reach_groups(sys.argv[1]).items():
    print(f'\n[arm.range_of_motion."{task}, {group}"]')
    for note in found.notes:
        print("#", note)
    for joint, limits in found.used.items():
        print(f"{joint}_deg = {np.degrees(limits).round(3).tolist()}")

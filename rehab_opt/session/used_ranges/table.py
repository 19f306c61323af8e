"""The ranges used and their workspaces as a table for the terminal."""

from __future__ import annotations

from rich.table import Table
from rich.text import Text

from rehab_opt.kinematics.human_arm import ARM_JOINTS
from rehab_opt.session.reach_rows import GROUPS, task_title
from rehab_opt.session.used_ranges.outcome import UsedRangesOutcome
from rehab_opt.session.workspaces.reached import handle_words, plane_words
from rehab_opt.session.workspaces.table import AREA_ROWS, percent, set_columns

__all__ = ["used_ranges_table"]


def used_ranges_table(outcome: UsedRangesOutcome) -> Table:
    """A section for each task, a column for each group; joints and quantities with their units."""
    caption = f"workspace of the range used, plane {plane_words(outcome.section)}, {handle_words(outcome.section)}"
    table = set_columns(outcome.title, GROUPS, caption)
    for task, of_task in outcome.tasks.items():
        groups = [outcome.metrics["groups"][of.label] for of in of_task]
        table.add_section()
        table.add_row(Text(f"{task_title(task)}: range used, deg", style="bold"))
        for joint in ARM_JOINTS:
            used = (numbers["range_used"][f"{joint}_deg"] for numbers in groups)
            table.add_row(f"   {joint.replace('_', ' ')}", *(f"{of['lower']:.0f} to {of['upper']:.0f}" for of in used))
        table.add_row(Text("workspace of the range used", style="bold"))
        for label, value in AREA_ROWS:
            table.add_row(f"   {label}", *(value(numbers) for numbers in groups))
        shares = (percent(numbers["share_inside_other_group"]) for numbers in groups)
        table.add_row("   share of it inside the other's, %", *shares)
    return table

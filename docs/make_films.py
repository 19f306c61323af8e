"""Make the films of shipped problems: `python docs/make_films.py [NAME ...]`; some minutes.

Those that the pages show by default; `all` makes one of each problem that is live, as `docs/pictures/film_NAME.gif`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from rehab_opt.errors import RehabOptError
from rehab_opt.live.film import write_film
from rehab_opt.session.files import load_problem, shipped_problems
from rehab_opt.session.run import live_problem

FOLDER = Path(__file__).parent / "pictures"
SHOWN = ("robot/ur5_circle", "ardis/through_doorway", "mirror/pick_fruit", "upper_limb/scenario_2_assist")
SECONDS, EACH_SECOND = 8.0, 8.0


def main(names: list[str]) -> None:
    """Make those, or the pages' own; what does not run live, or lacks its recording, is said and left out."""
    for name in shipped_problems() if names == ["all"] else names or SHOWN:
        place = FOLDER / f"film_{name.rpartition('/')[2]}.gif"
        try:
            write_film(live_problem(load_problem(name)), place, seconds=SECONDS, per_second=EACH_SECOND)
        except RehabOptError as refused:
            print(f"{name}: {refused}", file=sys.stderr)
            continue
        print(f"{name}: {place.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main(sys.argv[1:])

"""Make the films of shipped problems: `python docs/make_films.py [NAME ...]`; some minutes.

Those that the pages show by default, as `docs/pictures/film_NAME.gif`; `all` makes one of each problem that is live in
`out/films`, since together they are too large for the checkout.
"""

from __future__ import annotations

import sys
from pathlib import Path

from rehab_opt.errors import RehabOptError
from rehab_opt.live.film import write_film
from rehab_opt.session.files import load_problem, shipped_problems
from rehab_opt.session.run import live_problem

FOLDER = Path(__file__).parent / "pictures"
SHOWN = {
    "robot/ur5_circle": 4.0, "ardis/through_doorway": 8.0,
    "mirror/pick_fruit": 6.0, "upper_limb/scenario_2_assist": 8.0,
}  # fmt: skip
"""And how long each is [s]."""
EACH_SECOND = 8.0


def main(names: list[str]) -> None:
    """Make those, or the pages' own; what does not run live, or lacks its recording, is said and left out."""
    folder = Path("out/films") if names == ["all"] else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for name in shipped_problems() if names == ["all"] else names or SHOWN:
        place = folder / f"film_{name.rpartition('/')[2]}.gif"
        try:
            write_film(live_problem(load_problem(name)), place, seconds=SHOWN.get(name, 8.0), per_second=EACH_SECOND)
        except RehabOptError as refused:
            print(f"{name}: {refused}", file=sys.stderr)
            continue
        print(f"{name}: {place.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main(sys.argv[1:])

"""Run shipped problems and keep their numbers; print what differs from those kept before.

python -m tests.golden [--check] [NAME ...]    # all by default; --check keeps nothing: exit code 1 where one differs
"""

import json
import sys

from rehab_opt.session.files import shipped_problems
from tests.golden import FOLDER, differences, golden_file, measured

FOLDER.mkdir(exist_ok=True)
names, check, changed = [each for each in sys.argv[1:] if each != "--check"], "--check" in sys.argv, False
for name in names or shipped_problems():
    file, new = golden_file(name), measured(name)
    kept = json.loads(file.read_text()) if file.exists() else {}
    found = list(differences(kept, new)) if kept else ["new"]
    print(name, *found, sep="\n  ", flush=True)
    changed |= bool(found)
    if not check:
        columns = ",\n".join(f"{json.dumps(header)}: {json.dumps(cells)}" for header, cells in new["trace"].items())
        file.write_text(f'{{"metrics": {json.dumps(new["metrics"], indent=1)},\n"trace": {{\n{columns}\n}}}}\n')
sys.exit(int(check and changed))

"""Run shipped problems and keep their numbers; print what differs from those kept before.

python -m tests.golden [NAME ...]    # all by default
"""

import json
import sys

from rehab_opt.session.files import shipped_problems
from tests.golden import FOLDER, differences, golden_file, measured

FOLDER.mkdir(exist_ok=True)
for name in sys.argv[1:] or shipped_problems():
    file, new = golden_file(name), measured(name)
    kept = json.loads(file.read_text()) if file.exists() else {}
    print(name, *(["new"] if not kept else differences(kept, new)), sep="\n  ", flush=True)
    columns = ",\n".join(f"{json.dumps(header)}: {json.dumps(cells)}" for header, cells in new["trace"].items())
    file.write_text(f'{{"metrics": {json.dumps(new["metrics"], indent=1)},\n"trace": {{\n{columns}\n}}}}\n')

"""What a wheel, which has no solver comparison, says to `rehab-opt bench`."""

import subprocess
import sys
from pathlib import Path

import rehab_opt

WITHOUT_BENCH = """
import sys
sys.modules["bench"] = None  # an import of it fails, as where it is absent
from rehab_opt.cli import main
main(["bench"])
"""


def test_without_the_comparison_one_line_says_what_to_install(tmp_path: Path) -> None:
    root = Path(rehab_opt.__file__).parents[1]
    code = f"import sys; sys.path.insert(0, {str(root)!r}){WITHOUT_BENCH}"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert ".[bench]" in done.stderr
    assert list(tmp_path.iterdir()) == []

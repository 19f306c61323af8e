"""How the pages are built: `sphinx-build -W docs out/docs` (extra `docs`); nothing is loaded from a network."""

from __future__ import annotations

import sys
from pathlib import Path

import rehab_opt

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "rehab_opt"
author = "the authors of rehab_opt"
release = version = rehab_opt.__version__

extensions = ["myst_parser", "mathml", "from_package"]
myst_enable_extensions = ["dollarmath", "tasklist"]
myst_heading_anchors = 4
myst_links_external_new_tab = False
nitpicky = True
suppress_warnings = ["myst.header"]  # generated keys begin below the heading that a page gives them
exclude_patterns = ["extensions"]

html_theme = "furo"
html_title = f"rehab_opt {release}"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_math_renderer = "mathml"
html_show_copyright = False
html_show_sphinx = False
html_copy_source = False
html_theme_options = {"navigation_with_keys": True}

"""How the site is built: ./gossamer docs."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from gossamer_fx.version import VERSION

project = "gossamer_fx"
copyright = "the gossamer_fx contributors, LGPL-3.0-or-later"
version = release = VERSION
extensions = ["myst_parser", "generate"]
exclude_patterns = ["README.md"]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
suppress_warnings = ["myst.xref_ambiguous"]
add_module_names = False
toc_object_entries_show_parents = "hide"
python_display_short_literal_types = True

html_theme = "sphinx_book_theme"
html_title = f"gossamer_fx {VERSION}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_theme_options = {
    "use_download_button": False,
    "use_fullscreen_button": False,
    "show_toc_level": 2,
}
linkcheck_timeout = 20

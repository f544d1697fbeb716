"""How the site is built: ./gossamer docs."""

import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from gossamer_fx.version import VERSION  # noqa: E402  after the path is set

project = "gossamer_fx"
author = "the gossamer_fx contributors"
copyright = f"{author}, LGPL-3.0-or-later"
version = release = VERSION
extensions = [
    "myst_parser",
    # equations, typeset by a copy of MathJax that the site carries: pages are read without a
    # network too
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",
    # cards of the gallery
    "sphinx_design",
    # a button that copies a block of code, without its prompts
    "sphinx_copybutton",
    # the code behind each entry of the reference
    "sphinx.ext.viewcode",
    "generate",
]
exclude_patterns = ["README.md"]
myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
suppress_warnings = ["myst.xref_ambiguous"]
copybutton_prompt_text = r">>> |\.\.\. "
copybutton_prompt_is_regexp = True
add_module_names = False
toc_object_entries_show_parents = "hide"
python_display_short_literal_types = True

html_theme = "sphinx_book_theme"
html_title = f"gossamer_fx {VERSION}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_favicon = "static/favicon.svg"
# results of a search: guides first
html_search_scorer = str(HERE / "scorer.js")
html_theme_options = {
    "use_download_button": False,
    "use_fullscreen_button": False,
    "show_toc_level": 2,
    # one search box, at the top of the list of pages
    "use_sidenotes": False,
    "article_header_end": [],
    "navbar_persistent": [],
    "primary_sidebar_end": [],
}
# Links to the repository and to the source of each page appear when pyproject.toml names the
# repository.
REPOSITORY = (
    tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    .get("urls", {})
    .get("Repository")
)
if REPOSITORY:
    html_theme_options |= {
        "repository_url": REPOSITORY,
        "use_repository_button": True,
        "use_issues_button": True,
        "use_edit_page_button": True,
        "path_to_docs": "docs",
    }
linkcheck_timeout = 20

"""Build the site with Sphinx: ./gossamer docs [SPHINX OPTIONS]."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from children import run_child
from packages import ROOT, extra, folder_with

SITE = ROOT / "out" / "docs"


def main(options: Sequence[str]) -> int:
    """Build the site into out/docs; returns the exit code of Sphinx."""
    os.chdir(ROOT)
    paths = [str(folder_with(extra("docs"))), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in paths if path)}
    strict = ["--fail-on-warning", "--keep-going", "--quiet"]
    sphinx = [sys.executable, "-m", "sphinx", *strict, "docs", str(SITE)]
    code = run_child([*sphinx, *options], environment)
    # other builders, e.g. -b linkcheck, make no site
    if code == 0 and not any(option.startswith(("-b", "--builder", "-M")) for option in options):
        print(f"The site is in {SITE}; open {SITE / 'index.html'} in a browser.")
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

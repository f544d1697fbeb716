"""Check the code with ruff and mypy, and its words: ./gossamer lint."""

from __future__ import annotations

import os
import sys

from children import run_child
from packages import ROOT, extra, folder_with


def main() -> int:
    """Run all checks; returns 1 if one of them finds something."""
    os.chdir(ROOT)
    # mypy comes with the environment
    ruff_packages = [package for package in extra("lint") if package.startswith("ruff")]
    ruff = str(folder_with(ruff_packages) / "bin" / "ruff")
    checks = (
        [ruff, "check", "."],
        [ruff, "format", "--check", "."],
        [sys.executable, "-m", "mypy"],
        [sys.executable, "tools/words.py"],
    )
    codes = [run_child(check) for check in checks]
    return int(any(codes))


if __name__ == "__main__":
    sys.exit(main())

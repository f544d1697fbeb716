"""Run tests with the C kernels compiled for the address and undefined-behaviour sanitizers.

    ./gossamer python tools/sanitize.py tests/contact tests/reduction

An access beyond an array or an undefined operation ends the run with the line of the C file.
Memory that is not given back is not reported: Python and PETSc keep much of theirs until the
process ends.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile

FLAGS = "-fsanitize=address,undefined -fno-sanitize-recover=undefined -fno-omit-frame-pointer -g"
# Tests of the rooms that have C kernels of the package.
DEFAULT_TESTS = [
    "tests/contact",
    "tests/reduction",
    "tests/conservation/test_compartments.py",
    "tests/unit/test_cell_loops.py",
    "tests/unit/test_gas_openings.py",
]


def library_path(name: str) -> str:
    """Path of a library of the C compiler."""
    command = ["gcc", f"-print-file-name={name}"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def main() -> int:
    # The sanitizer replaces the function that throws C++ exceptions, and has to find the original:
    # Python itself is C, so that the C++ library would be loaded too late.
    preloaded = [library_path("libasan.so"), library_path("libstdc++.so.6")]
    with tempfile.TemporaryDirectory() as kernels:
        environment = {
            **os.environ,
            "GOSSAMER_CFLAGS": FLAGS,
            # The sanitizer has to be loaded before Python, which was not compiled with it.
            "LD_PRELOAD": " ".join(preloaded),
            "ASAN_OPTIONS": "detect_leaks=0",
            "UBSAN_OPTIONS": "print_stacktrace=1",
            # Kernels of this run are of no use for others.
            "XDG_CACHE_HOME": kernels,
        }
        command = [sys.executable, "-m", "pytest", "-x", *(sys.argv[1:] or DEFAULT_TESTS)]
        return subprocess.run(command, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())

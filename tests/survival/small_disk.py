"""Mount a file system of 2 MB in memory: python3 -m tests.survival.small_disk FOLDER; exit code 77
if refused.

The command `mount` is not everywhere; the call of the C library is.
"""

from __future__ import annotations

import ctypes
import sys

NOT_ALLOWED = 77


def main() -> int:
    mount = ctypes.CDLL(None, use_errno=True).mount
    failed = mount(b"tmpfs", sys.argv[1].encode(), b"tmpfs", ctypes.c_ulong(0), b"size=2m")
    return NOT_ALLOWED if failed else 0


if __name__ == "__main__":
    sys.exit(main())

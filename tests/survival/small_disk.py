"""Mount a file system of 2 MB in memory: python3 -m tests.survival.small_disk FOLDER; exit code 77
if refused.

The command `mount` is not everywhere; the call of the C library is.
"""

from __future__ import annotations

import ctypes
import sys

NOT_ALLOWED = 77
# Flags of mount(2).
MS_RDONLY = 1
MS_REMOUNT = 32
MS_BIND = 4096


def mount(source: str, folder: str, flags: int = 0, options: str = "") -> bool:
    """Mount a file system on a folder; whether the system allows it."""
    call = ctypes.CDLL(None, use_errno=True).mount
    words = source.encode(), folder.encode(), b"tmpfs"
    return call(*words, ctypes.c_ulong(flags), options.encode()) == 0


def made_read_only(folder: str) -> bool:
    """Put a folder on itself, read-only: files that are open stay so, others cannot be written."""
    again = MS_BIND | MS_REMOUNT | MS_RDONLY
    return mount(folder, folder, MS_BIND) and mount(folder, folder, again)


if __name__ == "__main__":
    sys.exit(0 if mount("tmpfs", sys.argv[1], options="size=2m") else NOT_ALLOWED)

"""Run Python with a program that encodes MP4: python3 tools/with_video.py WORDS ...

A private Debian tree hides the ffmpeg of the machine, and Debian's own would bring 200 packages.
The wheel of imageio-ffmpeg contains the program alone (30 MB); it is put into a folder of the
user's cache.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Sequence

from packages import extra, folder_with


def main(words: Sequence[str]) -> None:
    """Replace this process by Python with these words."""
    if shutil.which("ffmpeg") is None:
        paths = [os.environ.get("PYTHONPATH", ""), str(folder_with(extra("video")))]
        os.environ["PYTHONPATH"] = os.pathsep.join(path for path in paths if path)
    os.execv(sys.executable, [sys.executable, *words])


if __name__ == "__main__":
    main(sys.argv[1:])

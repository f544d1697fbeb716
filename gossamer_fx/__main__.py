"""python3 -m gossamer_fx run|watch|sweep|plot|report ..."""

import sys

# The current folder, which -m puts first: its files must not stand for numpy and the like.
if not sys.flags.safe_path:
    del sys.path[0]

from gossamer_fx.app.cli.command import main

sys.exit(main(sys.argv[1:]))

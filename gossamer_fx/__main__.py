"""python3 -m gossamer_fx run|watch|sweep|plot|report ..."""

import sys

from gossamer_fx.app.cli.command import main

sys.exit(main(sys.argv[1:]))

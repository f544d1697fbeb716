"""gossamer_fx: films that wrinkle, inflatables and what holds them, moved with exact conservation.

Seven houses, from the ground up: `core`, `mechanics`, `build`, `solve`, `records`, `analysis`,
`app`.  A module imports from its own house or from those before it.

The public names are listed in `__init__.pyi`: core names, e.g. `gx.Scene`, and namespaces, e.g.
`gx.gas`, each with its own list.  A name is imported when it is used.
"""

import sys

# Python finds the package of a command while the name of the program still is -m.
if sys.argv[:1] == ["-m"]:
    # The current folder, which `python3 -m gossamer_fx` puts first: its files must not stand for
    # numpy and the like.
    if not sys.flags.safe_path:
        del sys.path[0]
    # First, as Ctrl-C prints a trace until then.
    from gossamer_fx.core.checks.ctrl_c import end_at_ctrl_c

    end_at_ctrl_c()

from gossamer_fx.core.checks.door import Door
from gossamer_fx.core.checks.ending import watch_uncaught_errors
from gossamer_fx.core.checks.lazy_names import NamespaceFinder, lazy_names
from gossamer_fx.version import VERSION

__version__ = VERSION
__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)

sys.meta_path[:0] = [Door(), NamespaceFinder(__name__, __file__)]
watch_uncaught_errors()

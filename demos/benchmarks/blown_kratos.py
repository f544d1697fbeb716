"""The airbag of `airbag_kratos.py` while its pressure rises."""

from __future__ import annotations

import runpy
import sys

sys.argv.append("blown=1")
runpy.run_module("airbag_kratos")

"""The C compiler that Python and FFCx use."""

from __future__ import annotations

import os
import shlex
import shutil
import sysconfig

from gossamer_fx.core.checks.errors import check


def require_compiler() -> None:
    """Raise `InputError` if the C compiler cannot be found.

    It is the one that the variable CC names, or else the one that Python was built with, or else
    `cc`.
    """
    command = os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc"
    program = shlex.split(command)[0]
    check(
        shutil.which(program) is not None,
        f"The C compiler '{program}' is not there; install one (apt-get install gcc, or conda "
        "install c-compiler), "
        "or set the variable CC to the name of yours.",
    )

"""Python files of users: they are executed, and what is wrong with them is reported in one
sentence, with its line."""

from __future__ import annotations

import ast
import difflib
import inspect
import sys
import time
import traceback
from collections.abc import Callable, Iterable
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NoReturn

from gossamer_fx.core.checks.ctrl_c import CtrlC
from gossamer_fx.core.checks.door import import_from
from gossamer_fx.core.checks.ending import Interrupted, lacks_room
from gossamer_fx.core.checks.errors import (
    InputError,
    NoEquilibrium,
    OutputFailure,
    StepFailure,
    check,
)

if TYPE_CHECKING:
    from mpi4py import MPI


# Names that are similar to an unknown one and are proposed, at most.
_MAX_PROPOSALS = 3
# Attribute of modules that are files of users.
_OF_USER = "__file_of_user__"


def option(word: str) -> tuple[str, Any]:
    """Name and value of a word NAME=VALUE.

    Args:
        word: e.g. "cells=20".

    Raises:
        InputError: the word has another form.
    """
    name, equals, text = word.partition("=")
    check(
        bool(equals) and name.isidentifier(),
        f"'{word}' is not of the form NAME=VALUE; give arguments of build like cells=20.",
    )
    return name, value_of(text)


def value_of(text: str) -> Any:
    """What Python reads as a number, tuple, list or the like becomes that, true and false in any
    letters a truth value, anything else a word."""
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    try:
        return ast.literal_eval(text)
    # What cannot be a key of a dictionary is a TypeError; a text may be nested without end.
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        return text


def load(path: Path) -> ModuleType:
    """Execute a Python file as a module; other files of its folder can be imported.

    Args:
        path: of the file, which exists.

    Raises:
        InputError: its name is not that of a Python file.
        Exception: what the file itself raises.
    """
    from importlib.util import module_from_spec, spec_from_file_location

    import_from(path.resolve().parent)
    spec = spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise InputError(f"'{path}' is not a Python file; give one with a function build(comm).")
    # A file numpy.py would be taken for NumPy by everything that is imported later.
    known = sys.modules.get(path.stem)
    check(
        known is None or getattr(known, _OF_USER, False),
        f"'{path}' has the name of the Python module '{path.stem}', which is in use; rename it.",
    )
    module = module_from_spec(spec)
    # Data classes look up the module in which they are defined.
    sys.modules[path.stem] = module
    setattr(module, _OF_USER, True)
    # Its text, and not compiled code that lies next to it: that of a file which is changed twice in
    # a second would be taken for its own.
    exec(compile(path.read_bytes(), str(path), "exec", dont_inherit=True), module.__dict__)
    return module


def build_of(path: Path, module: ModuleType) -> Callable[..., Any]:
    """The function `build` of a scene file.

    Args:
        path: of the file, for the message.
        module: the file, which has been executed.

    Raises:
        InputError: it has none.
    """
    build = getattr(module, "build", None)
    check(
        callable(build),
        f"'{path}' has no function build(comm); write one that returns a gossamer_fx.Case.",
    )
    assert build is not None
    return build


def check_arguments_of(
    build: Callable[..., Any], path: Path, given: Iterable[tuple[str, Any]]
) -> None:
    """Refuse names and values that are not arguments of the function `build` of a scene file.

    Raises:
        InputError: names them and the arguments that there are; or a word in place of a truth
            value, which Python would take for true.
    """
    parameters = list(inspect.signature(build).parameters.values())
    check(
        bool(parameters),
        f"build in '{path}' takes no 'comm'; its first argument must be the communicator.",
    )
    known = parameters[1:]
    given = list(given)
    truths = [parameter.name for parameter in known if isinstance(parameter.default, bool)]
    for name, value in given:
        is_word = name in truths and isinstance(value, str)
        check(not is_word, f"build in '{path}': {name} is '{value}'; give true or false.")
    # A function with **options takes any name.
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in known):
        return
    arguments = [parameter.name for parameter in known]
    unknown = [name for name in dict(given) if name not in arguments]
    check(
        not unknown,
        f"build in '{path}' takes no {', '.join(unknown)}; its arguments are: "
        f"{', '.join(arguments) or 'none but the communicator'}.",
    )


def guarded[T](
    comm: MPI.Intracomm,
    path: Path,
    debug: bool,
    act: Callable[[], T],
) -> T:
    """Run code of the user's file, and end the program with one sentence if it fails.

    Args:
        comm: the ranks, all of which end.
        path: of the user's file.
        debug: whether errors are raised as they are.
        act: the code; its result is returned.

    Raises:
        InputError, StepFailure, NoEquilibrium, OutputFailure, Interrupted: as they are.
        ImportError, OSError: as it is, if there is no memory for a library.
        SystemExit: after any other error, with the code 2; the message has the line of the file.
    """
    try:
        return act()
    # Their messages are sentences already, and a full disk is not an error of the file.
    except (InputError, StepFailure, NoEquilibrium, OutputFailure, Interrupted, CtrlC):
        raise
    except BaseException as error:
        # Not an error of the file either, which imports libraries when it uses them.
        if debug or (lacks_room(error) and not isinstance(error, MemoryError)):
            raise
        # The innermost line that is in the user's file: the one to correct.
        frames = [
            f
            for f in traceback.extract_tb(error.__traceback__)
            if Path(f.filename).resolve() == path.resolve()
        ]
        line: int | None = None
        if isinstance(error, SyntaxError):
            line = error.lineno
        elif frames:
            line = frames[-1].lineno
        location = f"'{path}'"
        if line:
            location += f", line {line}"
        words = "no words"
        if str(error):
            words = str(error).splitlines()[0] + _proposal(error)
        end_program(
            comm,
            f"{location}: {type(error).__name__} ({words}); correct the file, or see more with "
            "--debug.",
            2,
        )


def _proposal(error: BaseException) -> str:
    """Names that are similar to an unknown one of an object, as a clause; empty if there are none.

    Python proposes them only in what it prints of an error that nobody catches, and names of this
    package are proposed in its own words already.
    """
    if "did you mean" in str(error):
        return ""
    if not isinstance(error, AttributeError) or error.obj is None or not error.name:
        return ""
    names = [name for name in dir(error.obj) if not name.startswith("_")]
    found = difflib.get_close_matches(error.name, names, n=_MAX_PROPOSALS)
    if not found:
        return ""
    return f"; did you mean {' or '.join(found)}?"


def end_program(comm: MPI.Intracomm, words: str, code: int = 1) -> NoReturn:
    """Say something on the first rank that comes here, and end the program on all."""
    # All ranks may come at once, as after Ctrl-C: the first one ends the others before they speak.
    if comm.rank > 0:
        time.sleep(0.5)
    print(f"gossamer: {words}", file=sys.stderr, flush=True)
    # Other ranks may be waiting for this one, and an exception would not end them.
    if comm.size > 1:
        comm.Abort(code)
    raise SystemExit(code)

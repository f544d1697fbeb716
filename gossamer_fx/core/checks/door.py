"""The door through which libraries come in: none of them reads the folder in which one stands.

PETSc reads `.petscrc` and `petscrc` of the current folder, petsc4py and slepc4py read `petsc.cfg`
and `slepc.cfg`, which name a library to load, and UCX, on which Open MPI stands, reads `ucx.conf`,
which names files to write.  dolfinx and FFCx read options there that change what forms compute,
matplotlib its `matplotlibrc`.  A folder with the recording of a stranger must not do that.  So
these libraries are imported while another folder is the current one, and PETSc is started without
such files.  A scene file may import modules next to it, but none that stands for a library
of this package, e.g. a file `gmsh.py`.

OpenBLAS waits for ever where it finds no memory for its buffer.  So it takes the buffer when NumPy
is imported, or the import fails.

What the user's own configuration says stays: `~/.config` for FFCx, dolfinx and matplotlib, and for
PETSc `PETSC_OPTIONS`, in which `-options_file NAME` names a file.

A library that was imported before `gossamer_fx` has read its files already.
"""

from __future__ import annotations

import functools
import itertools
import mmap
import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

from gossamer_fx.core.checks.ctrl_c import loading

# MiB of addresses that MPI, PETSc, dolfinx and NumPy take at their start: 581 on Debian 13; and
# NumPy alone, of which 128 are the buffer of OpenBLAS.  Where there are fewer, MPI and PETSc break
# off and OpenBLAS waits for ever.
_ROOM_FOR_LIBRARIES = 576
_ROOM_FOR_NUMPY = 256

# Variables that name the folder in which Open MPI writes files, the first one that is set.
_TEMPORARY = ("TMPDIR", "TEMP", "TMP")

# Rows of a matrix whose products need the buffer: OpenBLAS multiplies smaller ones without.
_NEEDS_BUFFER = 128

# A folder of this package, in which no library finds a file that it reads.
_EMPTY = Path(__file__).resolve().parent


# Options of PETSc that name a file with more options.
_OPTION_FILES = ("-options_file", "-options_file_yaml")

# What PETSc writes about an error: the words of it between these lines.
_PETSC_WORDS = r"Error Message -+\n(.*?)\[\d+\]PETSC ERROR: See "

# Descriptors of the folders that `_elsewhere` has left, one within the other: the first one is that
# in which the user stands.
_left: list[int] = []


@contextmanager
def _elsewhere() -> Iterator[None]:
    """Another current folder within the block."""
    # By its descriptor, as the path of a folder may be gone or unreadable.
    try:
        here = os.open(".", os.O_RDONLY | os.O_DIRECTORY)
    except OSError:
        os.chdir(_EMPTY)
        yield
        return
    os.chdir(_EMPTY)
    _left.append(here)
    try:
        yield
    finally:
        _left.pop()
        os.fchdir(here)
        os.close(here)


@contextmanager
def _where_the_user_stands() -> Iterator[None]:
    """The folder in which the user stands within a block of `_elsewhere`."""
    if not _left:
        yield
        return
    os.fchdir(_left[0])
    try:
        yield
    finally:
        os.chdir(_EMPTY)


# Errors about the configuration of the user: the __init__ of dolfinx turns any into others.
_refusals: list[Exception] = []


def is_refusal(error: BaseException) -> bool:
    """Whether an error says that a library does not start with the configuration of the user."""
    return any(error is refusal for refusal in _refusals)


def _refuse(words: str, error: Exception) -> NoReturn:
    """Raise the `InputError` about the configuration of the user that an error has shown."""
    # Its module imports MPI.
    from gossamer_fx.core.checks.errors import InputError

    refusal = InputError(words)
    _refusals.append(refusal)
    raise refusal from error


@contextmanager
def _readable_words() -> Iterator[None]:
    """Context in which `sys.argv` has no word that is not UTF-8, as a name of a file may be:
    dolfinx reads its options there, and breaks off at such a word."""
    words = sys.argv
    sys.argv = [word for word in words if word.isascii() or _has_utf8(word)]
    try:
        yield
    finally:
        sys.argv = words


def _has_utf8(word: str) -> bool:
    """Whether a word of the command line can be written in UTF-8."""
    try:
        word.encode()
    except UnicodeEncodeError:
        return False
    return True


def _start_petsc(module: ModuleType) -> None:
    """Start PETSc before the module does, without option files that nobody has named.

    Raises:
        InputError: a file that PETSC_OPTIONS names cannot be read, or PETSc refuses an option.
    """
    import petsc4py
    import petsc4py.lib

    # A text of options, which PETSc would read in addition to PETSC_OPTIONS.
    os.environ.pop("PETSC_OPTIONS_YAML", None)
    library = petsc4py.lib.ImportPETSc()
    options = os.environ.get("PETSC_OPTIONS", "")
    # Files are named from where the user stands; the libraries are loaded by now.
    with _where_the_user_stands():
        _check_option_files(options)
        said: list[str] = []
        try:
            # Without options PETSc has nothing to say.
            with _kept_words(said) if options else nullcontext():
                # The first word is the name of the program.
                library._initialize(["gossamer_fx", "-skip_petscrc"])
        except RuntimeError as error:
            found = re.search(_PETSC_WORDS, "".join(said), re.DOTALL)
            words = str(error)
            if found is not None:
                words = " ".join(re.sub(r"\[\d+\]PETSC ERROR:", " ", found[1]).split())
            _refuse(
                f"PETSc does not start with PETSC_OPTIONS='{options}' ({words}); correct the "
                "variable, or unset it.",
                error,
            )


def _check_option_files(options: str) -> None:
    """Raise `InputError` unless the files that PETSC_OPTIONS names can be read."""
    # Its module imports NumPy and MPI.
    from gossamer_fx.core.checks.strange_files import open_file

    words = options.split()
    for option, name in itertools.pairwise([*words, ""]):
        if option not in _OPTION_FILES:
            continue
        try:
            open_file(Path(name)).close()
        except (OSError, ValueError) as error:
            _refuse(
                f"PETSC_OPTIONS names the file '{name}' by {option}, which cannot be read "
                f"({error}); name another one, or leave the option out.",
                error,
            )


@contextmanager
def _kept_words(said: list[str]) -> Iterator[None]:
    """Context in which what a library writes to standard error is added to a list; at an end
    without an error it is written."""
    # Most programs do not need it.
    import tempfile

    sys.stderr.flush()
    stderr = os.dup(2)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
            file.seek(0)
            said.append(file.read().decode(errors="replace"))
    os.write(2, said[-1].encode())


def _read_options(module: ModuleType) -> None:
    """Let a module read its options now: it keeps them, and asks for them when a form is
    compiled."""
    try:
        module._load_options()
    except (OSError, ValueError) as error:
        library = module.__name__.partition(".")[0]
        _refuse(
            f"The file of options of {library} in your configuration cannot be read ({error}); "
            f"correct or remove it: XDG_CONFIG_HOME, or ~/.config, has a folder '{library}'.",
            error,
        )


def _check_docstrings(module: ModuleType) -> None:
    """Raise `InputError` if Python has left out docstrings, in which CFFI has its grammar."""
    from gossamer_fx.core.checks.errors import check

    check(
        sys.flags.optimize < 2,
        "Python was started without docstrings, in which CFFI has its grammar; leave -OO out, and "
        "unset PYTHONOPTIMIZE.",
    )


def _find_build_elsewhere(module: ModuleType) -> None:
    """Let petsc4py ask for its build while another folder is the current one: it does so again
    whenever dolfinx looks for the library."""
    find = module.getPathArch

    @functools.wraps(find)
    def find_elsewhere(*given: Any, **named: Any) -> Any:
        with _elsewhere():
            return find(*given, **named)

    module.getPathArch = find_elsewhere  # type: ignore[attr-defined]


def _check_room(module: ModuleType, needed: int = _ROOM_FOR_LIBRARIES) -> None:
    """Raise `MemoryError` if there are no addresses for libraries, in MiB."""
    # Not to be written, so that only a limit of the addresses refuses it.
    flags = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS
    try:
        mmap.mmap(-1, needed << 20, flags, mmap.PROT_READ).close()
    except OSError as error:
        raise MemoryError(f"libraries need {needed} MiB") from error


def check_temporary_folder() -> None:
    """Raise `OSError` if MPI cannot write its files: it breaks off in libraries then."""
    folder = next((os.environ[name] for name in _TEMPORARY if os.environ.get(name)), "/tmp")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OSError(
            f"MPI cannot write files in '{folder}'; set TMPDIR to a folder that can be written."
        )


def _check_start_of_mpi(module: ModuleType) -> None:
    """Raise `MemoryError` or `OSError` where MPI would break off."""
    check_temporary_folder()
    _check_room(module)


def _limit_blas(module: ModuleType) -> None:
    """Let OpenBLAS have one thread where the memory of a process is limited, unless the user says
    how many: each thread has a buffer.

    Raises:
        MemoryError: see `_check_room`.
    """
    import resource

    unlimited = resource.getrlimit(resource.RLIMIT_AS)[0] == resource.RLIM_INFINITY
    if not unlimited and not {"OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"} & set(os.environ):
        os.environ["OPENBLAS_NUM_THREADS"] = "1"
    _check_room(module, _ROOM_FOR_NUMPY)


def _take_buffer_of_blas(module: Any) -> None:
    """Let OpenBLAS take its buffer now; it keeps it."""
    square = module.ones((_NEEDS_BUFFER, _NEEDS_BUFFER))
    module.dot(square, square)


def _nothing(module: ModuleType) -> None:
    """Do nothing."""


def _raise_refusal(name: str, error: Exception) -> None:
    """Raise a sentence if the configuration of the user is the cause of an error of a library that
    is being imported."""
    if _refusals:
        raise _refusals[0] from error
    # A backend that it does not know.
    if name == "matplotlib" and type(error) is ValueError:
        _refuse(
            f"matplotlib does not start ({error}); correct the variable MPLBACKEND, or its own "
            "file matplotlibrc.",
            error,
        )


# What is done before and after each of these modules is executed.
_GUARDED: dict[str, tuple[Callable[[ModuleType], None], Callable[[ModuleType], None]]] = {
    # Both load the library of MPI, which loads UCX.
    "mpi4py.MPI": (_check_start_of_mpi, _nothing),
    "gmsh": (_nothing, _nothing),
    "numpy": (_limit_blas, _take_buffer_of_blas),
    # slepc4py takes the function of petsc4py.
    "petsc4py.lib": (_nothing, _find_build_elsewhere),
    "petsc4py.PETSc": (_start_petsc, _nothing),
    # Its __init__ catches any exception.
    "dolfinx": (_check_docstrings, _nothing),
    "dolfinx.jit": (_nothing, _read_options),
    "ffcx.options": (_nothing, _read_options),
    "matplotlib": (_nothing, _nothing),
}


# Libraries of this package, also optional ones, that are not taken from the folder of a scene file.
_LIBRARIES = frozenset(
    (
        *("basix", "cffi", "dolfinx", "erfa", "ezdxf", "ffcx", "gmsh", "matplotlib", "mpi4py"),
        *("numpy", "petsc4py", "PIL", "scipy", "setuptools", "slepc4py", "ufl"),
    )
)

# Folders from which other modules are imported, among them those of scene files.
# The empty one is the current folder, which Python puts first for -c and for a prompt.
_NOT_FOR_LIBRARIES = {""}


def import_from(folder: Path) -> None:
    """Let modules be imported from the folder of a scene file before those of other folders, as
    Python does for a script, except for libraries of this package."""
    _NOT_FOR_LIBRARIES.add(str(folder))
    sys.path.insert(0, str(folder))


class _GuardedLoader(Loader):
    """Executes a module while another folder is the current one."""

    def __init__(self, loader: Any, name: str) -> None:
        self._loader = loader
        self._before, self._after = _GUARDED[name]

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """The module as its own loader makes it."""
        # A module in C loads its libraries here.
        with _elsewhere():
            created: ModuleType | None = self._loader.create_module(spec)
        return created

    def exec_module(self, module: ModuleType) -> None:
        """Execute the module."""
        with _elsewhere(), loading(), _readable_words():
            self._before(module)
            try:
                self._loader.exec_module(module)
            except Exception as error:
                _raise_refusal(module.__name__, error)
                raise
            self._after(module)

    def __getattr__(self, name: str) -> Any:
        # Data files of the module are found by its own loader.
        return getattr(self._loader, name)


class Door(MetaPathFinder):
    """Finds the modules that are guarded, and libraries; the other finders find the rest."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The spec of a guarded module, with a loader that guards it, or of a library."""
        is_guarded = fullname in _GUARDED
        if not is_guarded and fullname not in _LIBRARIES:
            return None
        if path is None:
            path = [entry for entry in sys.path if entry not in _NOT_FOR_LIBRARIES]
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is None:
            return None
        if is_guarded and spec.loader is not None:
            spec.loader = _GuardedLoader(spec.loader, fullname)
        return spec

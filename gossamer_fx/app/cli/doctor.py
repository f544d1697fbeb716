"""Show the versions of everything, then check that it works: gossamer doctor."""

from __future__ import annotations

import importlib
import os
import platform
import subprocess
import sys
import tempfile
import time
from importlib import metadata
from pathlib import Path

from gossamer_fx.app.cli.launch import find_mpirun
from gossamer_fx.version import VERSION

NEEDED = (
    *("dolfinx", "basix", "ffcx", "ufl", "petsc4py", "mpi4py", "gmsh"),
    *("numpy", "scipy", "filelock"),
)
# what only modes, pictures, orbits, cut patterns, tests or checks of the code need
OPTIONAL = ("slepc4py", "matplotlib", "erfa", "ezdxf", "pytest", "hypothesis", "mypy")
# the solution of the check is linear, so that the elements have it exactly
SOLVER_TOLERANCE = 1e-12
# A program that prints 1 on each of two ranks that can add numbers.
SUM_OVER_RANKS = """
from mpi4py import MPI
print(MPI.COMM_WORLD.allreduce(1) // 2, end="")
"""


def main() -> int:
    """Print the versions of everything, and check that compiler, solver and MPI work.

    Returns:
        Exit code: 1 if something that is needed is missing or does not work, otherwise 0.
    """
    failures = show_versions()
    start = time.perf_counter()
    failures += compiled_form_failures()
    failures += rank_failures()
    for reason in failures:
        show("FAILED", reason)
    if failures:
        return 1
    seconds = time.perf_counter() - start
    show(
        "self-check",
        f"a form compiled and solved with PETSc LU, two MPI ranks agree, in {seconds:.1f} s",
    )
    return 0


def show(name: str, value: str) -> None:
    """One line of the table."""
    print(f"{name:16}{value}", flush=True)


def show_versions() -> list[str]:
    """Print environment, system, packages, MPI, compiler and BLAS, one line each.

    Returns:
        A sentence for each needed package that is missing or cannot be imported.
    """
    failures = []
    show("gossamer_fx", VERSION)
    show("environment", os.environ.get("GOSSAMER_ENVIRONMENT", f"this Python, {sys.prefix}"))
    show("system", f"{system_name()}, {os.cpu_count()} cores")
    show("processor", processor_name())
    show("python", f"{platform.python_version()}, {sys.executable}")
    for name in NEEDED:
        found = module_version(name) or "MISSING"
        show(name, found)
        if found.startswith("MISSING"):
            failures.append(f"the Python package {name} is {found}")
    for name in OPTIONAL:
        show(name, module_version(name) or "not installed")
    show("mpi", program_version(find_mpirun() or "mpirun"))
    show("compiler", program_version(os.environ.get("CC", "gcc")))
    threads = os.environ.get("OMP_NUM_THREADS", "not set")
    show("blas", f"{blas_files()}, OMP_NUM_THREADS={threads}")
    return failures


def system_name() -> str:
    """The distribution, e.g. Debian GNU/Linux 13 (trixie)."""
    try:
        return platform.freedesktop_os_release()["PRETTY_NAME"]
    except (OSError, KeyError):
        return platform.platform()


def processor_name() -> str:
    """The processor in the words of the system, e.g. AMD EPYC 9354 32-Core Processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    for line in lines:
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def module_version(name: str) -> str:
    """The version of a Python module, which is imported.

    Args:
        name: of the module.

    Returns:
        The version, "present" where it has none; empty if there is no such module; "MISSING (...)"
        with the reason if its import fails.
    """
    try:
        module = importlib.import_module(name)
    except Exception as error:
        if isinstance(error, ModuleNotFoundError) and error.name == name:
            return ""
        return f"MISSING ({type(error).__name__}: {error})"
    # dolfinx, basix, ffcx and ufl are distributed under longer names
    for distribution in (name, f"fenics-{name}"):
        try:
            return metadata.version(distribution)
        except metadata.PackageNotFoundError:
            pass
    return str(getattr(module, "__version__", "present"))


def program_version(program: str) -> str:
    """The first line that a program prints about its version; "MISSING" if it cannot be run."""
    try:
        done = subprocess.run([program, "--version"], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return "MISSING"
    return next((line for line in done.stdout.splitlines() if line.strip()), "MISSING")


def blas_files() -> str:
    """Paths of the BLAS libraries that this process has loaded, separated by commas.

    It reads the list of loaded files of Linux; on other systems it returns "unknown".
    """
    files = set()
    try:
        with open("/proc/self/maps") as maps:
            for line in maps:
                if "blas" in line:
                    files.add(os.path.realpath(line.split()[-1]))
    except OSError:
        return "unknown"
    return ", ".join(sorted(files)) or "not found"


def compiled_form_failures() -> list[str]:
    """Check that a form can be compiled, and solved by PETSc's LU in real double precision.

    Returns:
        One sentence about what is wrong; an empty list if nothing is.  Nothing is raised.
    """
    try:
        import numpy as np
        from petsc4py import PETSc

        error = solution_error()
        if PETSc.ScalarType is not np.float64:
            return ["PETSc does not compute in real double precision"]
    except Exception as failure:
        kind = type(failure).__name__
        return [f"a form could not be compiled and solved: {kind}: {failure}"]
    if not error < SOLVER_TOLERANCE:
        return [f"a compiled form solved with PETSc LU is wrong by {error:.1e}"]
    return []


def solution_error() -> float:
    """Largest nodal error of u - div grad u = f on a unit square, whose solution is x - 2 y.

    The solution is linear, so that the elements have it exactly: the error (dimensionless) is
    round-off if compiler and solver work.  Errors of dolfinx, the compiler and PETSc are raised as
    they are.
    """
    import numpy as np
    import ufl
    from dolfinx import fem, mesh
    from dolfinx.fem.petsc import assemble_matrix, assemble_vector
    from mpi4py import MPI
    from petsc4py import PETSc

    domain = mesh.create_unit_square(MPI.COMM_SELF, 8, 8)
    space = fem.functionspace(domain, ("Lagrange", 1))
    # u and v: trial and test function; A and b: matrix and right side.
    u = ufl.TrialFunction(space)
    v = ufl.TestFunction(space)
    x = ufl.SpatialCoordinate(domain)
    exact = x[0] - 2 * x[1]
    flux = ufl.dot(ufl.grad(exact), ufl.FacetNormal(domain))
    left = (ufl.inner(u, v) + ufl.inner(ufl.grad(u), ufl.grad(v))) * ufl.dx
    right = exact * v * ufl.dx + flux * v * ufl.ds
    # an empty cache: the forms are really compiled
    with tempfile.TemporaryDirectory() as folder:
        options = {"cache_dir": folder}
        A = assemble_matrix(fem.form(left, jit_options=options))
        b = assemble_vector(fem.form(right, jit_options=options))
    A.assemble()
    solver = PETSc.KSP().create(domain.comm)
    solver.setType("preonly")
    solver.getPC().setType("lu")
    solver.setOperators(A)
    solution = A.createVecRight()
    solver.solve(b, solution)
    expected = fem.Function(space)
    expected.interpolate(lambda points: points[0] - 2 * points[1])
    return float(np.abs(solution.array - expected.x.array).max())


def rank_failures() -> list[str]:
    """Check that two MPI ranks, which mpirun starts, can add a number.

    Returns:
        One sentence about what is wrong, or a warning that MPI prints; an empty list otherwise.
    """
    mpirun = find_mpirun()
    if mpirun is None:
        return ["two MPI ranks do not work together: there is no mpirun"]
    done = subprocess.run(
        [mpirun, "-n", "2", sys.executable, "-P", "-c", SUM_OVER_RANKS],
        # Not the current folder, of which MPI reads files.
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
    )
    if done.returncode or done.stdout.strip() != "11":
        return [f"two MPI ranks do not work together: {done.stdout}{done.stderr}"]
    if done.stderr.strip():
        return [f"MPI warns: {done.stderr.strip()}"]
    return []

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spack package: copy to packages/py_gossamer_fx of a Spack repository."""

from spack.package import depends_on, license, variant, version
from spack_repo.builtin.build_systems.python import PythonPackage


class PyGossamerFx(PythonPackage):
    """Gossamer structures (films that wrinkle, inflatables, cables, rigid bodies) on FEniCSx."""

    # At a release: homepage, pypi and the checksum of the sdist take the place of `develop`.
    license("LGPL-3.0-or-later")

    version("develop", branch="main")

    variant("pictures", default=True, description="Pictures and reports")
    variant("orbit", default=False, description="Sun, Moon and axes of the Earth of a date")

    depends_on("c", type="run")  # kernels are compiled at their first use
    depends_on("python@3.12:", type=("build", "run"))
    depends_on("py-hatchling@1.27:", type="build")
    depends_on("py-numpy", type=("build", "run"))
    depends_on("py-scipy", type=("build", "run"))
    depends_on("py-filelock", type=("build", "run"))
    depends_on("py-fenics-dolfinx@0.9:0.11", type=("build", "run"))
    depends_on("py-petsc4py ^petsc~complex+mumps", type=("build", "run"))
    depends_on("py-slepc4py", type=("build", "run"))
    depends_on("py-mpi4py", type=("build", "run"))
    depends_on("gmsh+shared", type=("build", "run"))
    depends_on("py-matplotlib", type=("build", "run"), when="+pictures")

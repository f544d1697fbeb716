"""What a step needs on several ranks: iterations, arithmetic and messages, counted on each rank.

Counts are right on a machine with fewer cores than ranks, where times are not.  Messages and
collective operations are counted by a library that is loaded before MPI's (`count_messages.c`).
Arithmetic is that of PETSc's vectors, matrices and incomplete factorisations, and of MUMPS where it
factorises the whole matrix; that of laws and forms grows with the cells of a rank.
"""

from __future__ import annotations

import ctypes
import os
from typing import Any

import numpy as np
from mpi4py import MPI
from newton_times import choose_levels
from petsc4py import PETSc
from stopwatch import Stopwatch

import gossamer_fx as gx
from demos.antennas import antenna_pendulum
from demos.films import spinning_sheet
from demos.inflatables import inflate_tube
from demos.sails import ikaros
from gossamer_fx.extend import MeshBody

Figures = dict[str, float]
COMM = MPI.COMM_WORLD

# Control parameter of MUMPS: RINFO(3), the operations of this rank's part of a factorisation.
RINFO_OPERATIONS = 3


def message_counts() -> np.ndarray:
    """This rank's counts since the program began: messages, their bytes, collective operations and
    their bytes, of C in the first row and of Fortran in the second."""
    loaded = os.environ.get("LD_PRELOAD", "")
    if "count_messages" not in loaded:
        return np.zeros((2, 4))
    counts = (ctypes.c_double * 8).in_dll(ctypes.CDLL(loaded), "counts")
    return np.array(counts).reshape(2, 4)


def factorisation_flops(ksp: PETSc.KSP) -> float:
    """Operations of this rank in a factorisation of the whole matrix, if there is one."""
    pc = ksp.getPC()
    if pc.getType() != "lu":
        return 0.0
    return float(pc.getFactorMatrix().getMumpsRinfo(RINFO_OPERATIONS))


def built(scene: str, size: int) -> tuple[gx.Simulation, float]:
    """The simulation of a scene, and the length of its first steps [s]."""
    if scene == "tube":
        dt = 1e-4
        case = inflate_tube.build(COMM, cells=size, dt=dt)
    elif scene == "sail":
        dt = 2e-3
        case = ikaros.build(COMM, pitch=0.282, refine=size, dt=dt)
    elif scene == "antenna":
        dt = 5e-3
        case = antenna_pendulum.build(COMM, size, 2 * size, dt=dt)
    else:
        dt = 1e-3
        case = spinning_sheet.build(COMM, size, dt=dt)
    return case.simulation(), dt


def rank_counts(scene: str = "sheet", size: int = 40, steps: int = 2, levels: int = 0) -> Figures:
    """Counts of the first steps of a scene, in a step: messages and their bytes of all ranks,
    collective operations in which each rank takes part; and the messages to each neighbour for one
    Krylov iteration.  The coarse space has the given number of `levels` if this is not 0."""
    if levels:
        choose_levels(levels)
    watch = Stopwatch()
    run, dt = built(scene, size)
    flops = -PETSc.Log.getFlops()
    counts = -message_counts()
    figures = watch.measure(run, steps * dt)
    flops += PETSc.Log.getFlops()
    counts += message_counts()
    newton_iterations = figures["Newton/step"] * figures["steps"]
    flops += newton_iterations * factorisation_flops(run.solver.newton.ksp)
    bodies = [body for body in run.system.unknowns.bodies if isinstance(body, MeshBody)]
    cells = sum(owned_cells(body) for body in bodies)
    neighbours = COMM.allreduce(sum(neighbours_of(body) for body in bodies))

    def in_a_step(of_this_rank: Any) -> Any:
        return COMM.allreduce(of_this_rank) / figures["steps"]

    all_messages, all_bytes, all_collectives, _ = in_a_step(counts.sum(axis=0))
    krylov_in_a_step = figures["Krylov/Newton"] * figures["Newton/step"]
    return {
        "dofs": figures["dofs"],
        "steps": figures["steps"],
        "Newton/step": figures["Newton/step"],
        "Krylov/step": krylov_in_a_step,
        "messages": all_messages,
        "to a neighbour": all_messages / max(krylov_in_a_step * neighbours, 1.0),
        "MB": all_bytes / 1e6,
        "collectives": all_collectives / COMM.size,
        "of MUMPS": in_a_step(counts[1, 2]) / COMM.size,
        "Gflop": in_a_step(flops) / 1e9,
        "flops, imbalance": imbalance(flops),
        "cells, imbalance": imbalance(cells),
        "wall": figures["wall"],
        "energy": figures["energy"],
        "ΔE/E": figures["ΔE/E"],
    }


def imbalance(of_this_rank: float) -> float:
    """The largest number of all ranks over their mean."""
    return COMM.allreduce(of_this_rank, op=MPI.MAX) * COMM.size / COMM.allreduce(of_this_rank)


def owned_cells(body: MeshBody) -> int:
    """Cells of this rank, on which it evaluates the law and assembles."""
    topology = body.space.mesh.topology
    return int(topology.index_map(topology.dim).size_local)


def neighbours_of(body: MeshBody) -> int:
    """Other ranks that own nodes of this rank's cells."""
    return len(set(body.space.dofmap.index_map.owners))

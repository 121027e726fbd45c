"""How MuJoCo solves a system: integrator, cone, Newton's method, and an order for it."""

import mujoco

from sim.parameters.fidelity import Fidelity


def set_solver(spec: mujoco.MjSpec, step: float) -> None:
    """Choose step, integrator, cone and solver: these need three to four iterations a step."""
    option = spec.option
    option.timestep = step
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 1.0
    # Noise of an assessment is this: with 1e-8 it is 0.2 % of what the error varies by over Table
    # 1, with this the fifth decimal; 5 to 10 % more time.
    option.tolerance = 1e-10
    option.iterations = 50
    # On a NaN MuJoCo would reset state and time and go on; a failure must stay visible.
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    # Arm and exoskeleton in contact are one island, which need not be found anew at every step.
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND


def set_interface_solver(spec: mujoco.MjSpec, fidelity: Fidelity) -> None:
    """Choose what depends on whether exoskeleton and arm meet in contact."""
    option = spec.option
    if not fidelity.contact:
        # Nothing meets, and nine dense columns are cheaper than their pattern.
        option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        return
    option.impratio = fidelity.impratio
    if fidelity.pyramids:
        option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    _let_the_solver_reorder(spec)


def _let_the_solver_reorder(spec: mujoco.MjSpec) -> None:
    """Add an edge between two fixed points, which moves nothing and meets nothing.

    Newton's sparse solver looks for an order with little fill-in only in models that have a flex.
    Arm and exoskeleton are two trees that meet in a hundred contacts, where the order of bodies is
    a bad one whichever tree comes first; with this the factor has half the entries.
    """
    edge = spec.add_flex(name="fixed_edge", dim=1, radius=1e-3)
    edge.vertbody, edge.vert = ["world", "world"], [0.0, 0.0, 0.0, 0.01, 0.0, 0.0]
    edge.elem = [0, 1]
    edge.contype = edge.conaffinity = edge.selfcollide = 0

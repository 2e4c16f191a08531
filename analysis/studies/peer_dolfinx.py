"""A bar under its weight by DOLFINx, on tetrahedra that it is given: run by the Python of Debian's python3-dolfinx.

Usage: /usr/bin/python3 peer_dolfinx.py IN.npz OUT.npz

IN: points (n, 3) in m, tetrahedra (m, 4), degree, E in Pa, nu, weight (3) in N/m3, tolerance. The least x is constrained.
OUT: displacement u of the points (n, 3) in m, n_unknowns, solver, seconds of processor for mesh, assembly and solution. Forms are
compiled before. The solver is the faster one of two: conjugate gradients with PETSc's algebraic multigrid, which knows the rigid
motions, and MUMPS' Cholesky factor.
"""

import sys
import time

import numpy as np
import ufl
from dolfinx import fem, la, mesh
from mpi4py import MPI
from petsc4py import PETSc


def rigid_motions(V):
    """The near-null space of elasticity, orthonormal."""
    basis = [la.create_petsc_vector(V.dofmap.index_map, V.dofmap.index_map_bs) for _ in range(6)]
    x, y, z = V.tabulate_dof_coordinates().T
    fields = np.zeros((6, len(x), 3))
    for c in range(3):
        fields[c, :, c] = 1
    fields[3, :, 0], fields[3, :, 1] = -y, x
    fields[4, :, 0], fields[4, :, 2] = z, -x
    fields[5, :, 1], fields[5, :, 2] = -z, y
    for vector, column in zip(basis, np.linalg.qr(fields.reshape(6, -1).T)[0].T, strict=True):
        vector.array[:] = column
    return PETSc.NullSpace().create(vectors=basis)


def solve(case, is_trial=False):
    """Displacement at the points, number of unknowns, solver and seconds."""
    begin = time.process_time()
    element = ufl.VectorElement("Lagrange", ufl.tetrahedron, 1)
    tetrahedra = case["tetrahedra"][: 1 if is_trial else None].astype(np.int64)
    domain = mesh.create_mesh(MPI.COMM_SELF, tetrahedra, case["points"], ufl.Mesh(element))
    V = fem.VectorFunctionSpace(domain, ("Lagrange", int(case["degree"])))
    E, nu = float(case["E"]), float(case["nu"])
    mu, lame = (fem.Constant(domain, c) for c in (E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))))
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    strain, trace = ufl.sym(ufl.grad(u)), ufl.div(u)
    stiffness = fem.form(
        (2 * mu * ufl.inner(strain, ufl.sym(ufl.grad(v))) + lame * trace * ufl.div(v)) * ufl.dx
    )
    load = fem.form(ufl.dot(fem.Constant(domain, case["weight"]), v) * ufl.dx)
    if is_trial:
        return None
    least = case["points"][:, 0].min()
    constrained = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[0], least))
    support = fem.dirichletbc(np.zeros(3), constrained, V)
    A = fem.petsc.assemble_matrix(stiffness, bcs=[support])
    A.assemble()
    b = fem.petsc.assemble_vector(load)
    fem.petsc.set_bc(b, [support])
    prepared = time.process_time() - begin
    solvers = {}
    for name in ("multigrid", "Cholesky"):
        begin = time.process_time()
        found = fem.Function(V)
        solver_of(name, A, V, float(case["tolerance"])).solve(b, found.vector)
        solvers[name] = time.process_time() - begin, found
    name, (seconds, found) = min(solvers.items(), key=lambda entry: entry[1][0])
    return at_points(domain, found), 3 * V.dofmap.index_map.size_global, name, prepared + seconds


def solver_of(name, A, V, tolerance):
    A.setOption(PETSc.Mat.Option.SPD, True)
    solver = PETSc.KSP().create(MPI.COMM_SELF)
    solver.setOperators(A)
    solver.setErrorIfNotConverged(True)
    if name == "Cholesky":
        solver.setType("preonly")
        solver.getPC().setType("cholesky")
        solver.getPC().setFactorSolverType("mumps")
    else:
        A.setNearNullSpace(rigid_motions(V))
        solver.setType("cg")
        solver.getPC().setType("gamg")
        solver.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        solver.setTolerances(rtol=tolerance, max_it=2000)
    return solver


def at_points(domain, found):
    """In the order in which the points were given."""
    V = fem.VectorFunctionSpace(domain, ("Lagrange", 1))
    at_vertices = fem.Function(V)
    at_vertices.interpolate(found)
    values = at_vertices.x.array.reshape(-1, 3)
    given = np.asarray(domain.geometry.input_global_indices)
    u = np.zeros((len(given), 3))
    for cell in range(domain.topology.index_map(3).size_local):
        u[given[domain.geometry.dofmap.links(cell)]] = values[V.dofmap.cell_dofs(cell)]
    return u


def main():
    case = dict(np.load(sys.argv[1]))
    solve(case, is_trial=True)
    u, n_unknowns, solver, seconds = solve(case)
    np.savez(sys.argv[2], u=u, n_unknowns=n_unknowns, solver=solver, seconds=seconds)


main()

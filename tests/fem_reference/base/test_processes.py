"""The reference under mpirun: what several processes solve is what one solves, and each holds its share."""

import json
import os
import subprocess

import numpy as np
import pytest
import pyvista as pv

from analysis.paths import PROGRAMS, ROOT
from analysis.runs import load_run

TOLERANCE = 1e-9  # solves stop at 1e-12 of the load, which a displacement multiplies by the matrix' condition
ROUNDED = ("lost_to_scheme",)  # a small difference of large numbers
PULLED = ROOT / "tests" / "fem_reference" / "base" / "hollow_ball_pulled.toml"


def solve(scene, folder, overrides, n=1, options=()):
    sets = [word for override in overrides for word in ("--set", override)]
    launcher = ("mpirun", "--oversubscribe", "-np", str(n)) if n > 1 else ()
    return subprocess.run(
        [
            *launcher,
            PROGRAMS / "fem_reference",
            ROOT / "analysis" / "scenes" / scene,
            "--quiet",
            "--out",
            folder,
            *options,
            *sets,
        ],
        env={**os.environ, "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"},
        capture_output=True,
        text=True,
    )


def run(scene, folder, overrides, n=1, options=()):
    done = solve(scene, folder, overrides, n, options)
    assert done.returncode == 0, done.stderr
    found = load_run(folder)
    assert found.record["processes"] == n
    return found


def assert_alike(one, several, tolerance=TOLERANCE):
    """Frames, curves and record."""
    frames = [of.grid(-1) for of in (one, several)]
    for name in frames[0].point_data:
        a, b = (frame[name] for frame in frames)
        assert np.abs(b - a).max() < tolerance * np.abs(a).max()
    for kind, cells in frames[0].cells_dict.items():
        ordered = [np.unique(frame.cells_dict[kind], axis=0) for frame in frames]
        assert len(ordered[0]) == len(cells)
        assert (ordered[0] == ordered[1]).all()
    assert pv.read(several.file(-1)).n_cells == frames[0].n_cells, "by VTK's own reader"
    assert np.abs(several.last.u - one.last.u).max() < tolerance * np.abs(one.last.u).max()
    assert (several.last.F == one.last.F).all()
    for name, values in one.curves.items():
        components = [name[:-1] + axis for axis in "xyz"] if name.endswith(("_x", "_y", "_z")) else [name]
        largest = max(np.abs(one.curves[component]).max() for component in components)
        if name not in ROUNDED:
            np.testing.assert_allclose(several.curves[name], values, rtol=tolerance, atol=tolerance * largest)
    for name in ("n_nodes", "n_dofs", "n_tetrahedra", "is_free", "mesh_hash"):
        assert several.record[name] == one.record[name]


HANDLES = (  # of a region that not all processes have a part of, and of a vertex, from half the load on
    "handles=[{region={box={low=[0.6,0.5,0],high=[1,1,1]},relative=true},stiffness=2e4,motion=[[0,0,0,0],[0.004,0,0.002,0.001]]},"
    "{vertex=7,stiffness=1e3,start=0.002,motion=[[0,0,0.01,0]]}]",
)

STIFF_SKIN = ("skin.stiffness=1e4", "skin.bending=10")  # beside a body of 1e5 Pa
INFLATED = ("volume.coefficient=1e5", "time.load_steps=2", "time.residual=1e-12")
HELD = ("loads=[]", "volume.exact=true", "volume.target=[[0,1],[1,1.2]]", "time.load_steps=2")

COARSE = "surface.n_vertices=100"
SHRUNK = ("loads=[]", "collapse.coefficient=0.1", "collapse.pivots=[{point=[0,0.5,0]}]", "time.load_steps=2")
SEAM = (  # between parts that not all processes have
    "seams=[{from={box={low=[0.3,0,0],high=[0.5,1,0]},relative=true},"
    "to={box={low=[0.7,0,0],high=[1,1,1]},relative=true},stiffness=1e3}]",
)
RELIEVED = ("gravity=[0,-9.81,0]", "reference.inertia_relief=true")


@pytest.mark.parametrize(
    "scene, degree, n, also",
    [
        ("bar_sag.toml", 1, 2, ()),
        ("bar_sag.toml", 2, 3, ("reference.refine=1",)),
        ("ball_pressure.toml", 2, 4, ()),
        ("ball_collapse.toml", 1, 2, ()),
        ("ball_collapse.toml", 2, 2, ()),
        ("bar_bend.toml", 2, 3, ("time.load_steps=2", "time.residual=1e-12")),
        (PULLED, 1, 2, ()),
        (PULLED, 2, 2, ()),
        ("bar_sag.toml", 2, 3, (*HANDLES, "time.residual=1e-12")),
        (PULLED, 1, 4, HANDLES),
        ("inflate.toml", 1, 3, INFLATED),
        ("inflate.toml", 2, 3, (*HELD, "time.residual=1e-12")),
        ("inflate.toml", 1, 3, (*INFLATED, *STIFF_SKIN)),
        ("inflate.toml", 2, 4, (*INFLATED, *STIFF_SKIN)),
        ("inflate.toml", 1, 2, (*SHRUNK, *STIFF_SKIN, COARSE, "time.residual=1e-12")),
        ("bar_sag.toml", 2, 4, (*SEAM, COARSE, "time.load_steps=1", "time.residual=1e-12")),
        ("ball_pressure.toml", 1, 2, (*RELIEVED, COARSE)),
    ],
)
def test_several_processes_solve_what_one_does(scene, degree, n, also, tmp_path):
    overrides = ["surface.n_vertices=324", f"reference.degree={degree}", *also]
    assert_alike(run(scene, tmp_path / "one", overrides), run(scene, tmp_path / "several", overrides, n))


SMALL = "surface.n_vertices=150"
EXPLICIT = ("time.integrator=implicit_euler", "reference.integrator=central_differences")
DRIVEN = (  # by the lowest face, of which each process has a part
    "supports.0.region={box={low=[0,0,0],high=[1,0,1]},relative=true}",
    "supports.0.motion=[[0,0,0,0],[0.002,0,0.01,0]]", "supports.0.end=0.003", "material.damping=20", "material.law=neo_hookean",
    "collapse.coefficient=0.9", "collapse.pivots=[{point=[0.4,0,0]}]",
)  # fmt: skip


FLUNG = (  # a half of which not all processes have a part, and all of it
    "initial=[{region={box={low=[0.5,0,0],high=[1,1,1]},relative=true},velocity=[0,0,1],spin=[20,0,0]},{velocity=[0,0.1,0]}]",
    "material.law=neo_hookean",
)  # fmt: skip
FOLLOWER = "loads=[{pressure=1e6, follower=true}]"
SKIN = ("skin.stiffness=1e4", "skin.bending=1")
RELAXING = (*SKIN, "skin.relaxation=0.5", "time.end=1e-3")
BAG = (*SKIN, "volume.coefficient=1e8", "volume.target=[[0,1],[0.004,1.001]]")


@pytest.mark.parametrize(
    "degree, n, also",
    [
        (1, 2, ()),
        (1, 4, DRIVEN),
        (2, 3, DRIVEN),
        (1, 2, ("material.law=neo_hookean", FOLLOWER)),
        (1, 4, FLUNG),
        (1, 4, SKIN),
        (2, 3, SKIN),
    ],
)
def test_several_processes_take_explicit_steps_as_one_does(degree, n, also, tmp_path):
    step = {1: "2e-5", 2: "5e-6"}[degree]  # stable
    overrides = [*EXPLICIT, SMALL, f"reference.degree={degree}", f"time.step={step}", "time.end=4e-3", *also]
    one, several = (run("bar_swing.toml", tmp_path / str(p), overrides, p) for p in (1, n))
    assert_alike(one, several)
    flows = {"work_of_loads"} | ({"work_of_supports", "lost_to_damping"} if also is DRIVEN else set())
    assert all(np.abs(one.curves[name]).max() > 0 for name in flows)


@pytest.mark.parametrize(
    "degree, n, also",
    [
        (1, 2, ()),
        (2, 3, ("reference.spectral_radius=0.5", "material.stiffness_damping=1e-5")),
        (1, 4, DRIVEN),
        (2, 2, (*DRIVEN, "reference.integrator=minimising_euler")),
        (1, 3, ("material.law=neo_hookean", FOLLOWER)),
        (2, 4, FLUNG),
        (1, 4, ("supports.0.end=0.002",)),  # which not all processes have a part of
        (1, 4, HANDLES),
        (2, 3, (*DRIVEN, *HANDLES)),
        (1, 3, BAG),
        (2, 2, BAG),
        (1, 2, (*DRIVEN, *RELAXING)),
        (1, 4, (*SEAM, "time.end=1e-3")),
        (1, 4, ("volume.exact=true", *BAG[3:], "reference.integrator=minimising_euler")),
    ],
)
def test_several_processes_take_implicit_steps_as_one_does(degree, n, also, tmp_path):
    overrides = [
        SMALL,
        "time.step=2.5e-4",
        "time.end=4e-3",
        "time.residual=1e-12",
        f"reference.degree={degree}",
        *also,
    ]
    one, several = (run("bar_swing.toml", tmp_path / str(p), overrides, p) for p in (1, n))
    assert_alike(one, several)
    assert several.record.get("n_steps_halved") == one.record.get("n_steps_halved")


PRESSED = (  # a body that friction alone holds
    "obstacles=[{plane={point=[0,0,0],normal=[0,1,0]},friction=0.4},"
    "{plane={point=[0,1,0],normal=[0,-1,0]},motion=[[0,0,0,0],[1,0,-0.1,0]],friction=0.4}]",
    "time.load_steps=2",
)
RAISED = (  # the floor under a ball, which it meets at once
    "obstacles=[{plane={point=[0,-1.001,0],normal=[0,1,0]},motion=[[0,0,0,0],[1,0,0.1,0]],friction=0.3}]",
    "surface.n_vertices=42",
    "time.end=0.03",
)
OVERLAPPED = (  # by spheres, from below
    'obstacles=[{sphere={center=[0.3,-1.7,0],radius=1},initially="resolve",friction=0.3}]',
    "surface.n_vertices=42",
    "time.end=0.02",
)
OVERLAPPED_HELD = (
    'obstacles=[{sphere={center=[0.35,-0.008,0.05],radius=0.01},initially="resolve",friction=0.3}]',
    "surface.n_vertices=80",
    "time.step=2.5e-4",
    "time.end=5e-4",
)
SAGGING = (
    "surface.n_vertices=80",
    "obstacles=[{plane={point=[0.3,-3e-4,0],normal=[0,1,0]},friction=0.3}]",
)


# Iterations of contact end where a correction is 1e-9 of the body, of which its displacement is a part. Forces go with
# one over the gaps.
@pytest.mark.parametrize(
    "scene, degree, n, also, tolerance",
    [
        ("bar_sag.toml", 2, 3, SAGGING, 1e-7),
        ("cube_pressed.toml", 1, 4, PRESSED, 1e-7),
        ("ball_drop.toml", 2, 3, RAISED, 2e-5),
        ("ball_drop.toml", 1, 2, OVERLAPPED, 2e-5),
        ("bar_swing.toml", 1, 4, OVERLAPPED_HELD, 2e-5),
    ],
)
def test_several_processes_press_obstacles_as_one_does(scene, degree, n, also, tolerance, tmp_path):
    overrides = [f"reference.degree={degree}", "time.residual=1e-12", *also]
    one, several = (run(scene, tmp_path / str(p), overrides, p) for p in (1, n))
    assert np.abs(one.curves["obstacle_0_force_x"]).max() > 0, "friction"
    assert_alike(one, several, tolerance)


def test_several_processes_part_a_body_from_itself_as_one_does(tmp_path):
    """Cubes in one surface, one thrown onto the other: all points of contact join two processes."""
    cubes = [pv.Cube(center=(0.2 * k, 1.03 * k, 0.1 * k)).triangulate().subdivide(1).clean() for k in (0, 1)]
    cubes[0].append_polydata(cubes[1]).save(tmp_path / "cubes.ply")
    upper = "{box={low=[0,0.5,0],high=[1,1,1]},relative=true}"
    overrides = [
        'surface.shape=""',
        f'surface.file="{tmp_path}/cubes.ply"',
        f"initial=[{{region={upper},velocity=[0.5,-1,0]}}]",
        "obstacles=[]",
        "self_contact.on=true",
        "self_contact.friction=0.3",
        "reference.degree=1",
        "time.step=0.01",
        "time.end=0.06",
        "time.residual=1e-12",
    ]
    one, two, four = (run("ball_drop.toml", tmp_path / str(p), overrides, p) for p in (1, 2, 4))
    assert one.curves["self_contact_energy"].max() > 0 and one.curves["lost_to_friction"].max() > 0
    for several in (two, four):
        assert_alike(one, several, 1e-7)


@pytest.mark.parametrize(
    "scene, degree, also",
    [("bar_sag.toml", 2, ()), ("ball_pressure.toml", 1, ()), ("bar_sag.toml", 2, BAG[:3])],
)
def test_several_processes_find_the_frequencies_of_one(scene, degree, also, tmp_path):
    overrides = ["surface.n_vertices=80", f"reference.degree={degree}", *also]
    one, several = (
        run(scene, tmp_path / str(p), overrides, p, ("--frequencies", "3")).record for p in (1, 2)
    )
    assert several["natural_frequencies"] == pytest.approx(one["natural_frequencies"], rel=1e-8)
    assert several["n_zero_frequencies"] == one["n_zero_frequencies"] == (6 if one["is_free"] else 0)


def test_several_processes_damp_as_one_does_by_a_ratio(tmp_path):
    overrides = [
        *EXPLICIT,
        "material.damping_ratio=0.1",
        "time.step=2e-5",
        "time.end=2e-4",
        "reference.degree=1",
    ]
    one, several = (run("bar_swing.toml", tmp_path / str(p), overrides, p).record for p in (1, 2))
    assert several["mass_damping"] == pytest.approx(one["mass_damping"], rel=1e-8)


def test_several_processes_refuse_to_go_on_from_where_one_was_stopped(tmp_path):
    overrides = [*EXPLICIT, "surface.n_vertices=100", "time.step=5e-6", "time.end=100"]
    assert solve("bar_swing.toml", tmp_path, overrides, 1, ("--budget", "1")).returncode == 2
    done = solve("bar_swing.toml", tmp_path, overrides, 2)
    assert done.returncode == 1 and "expected the one process that it began with, or --force" in done.stderr


ENDLESS = (*EXPLICIT, COARSE, "time.step=5e-6", "time.end=100", "output.frames_every=1000")


@pytest.mark.parametrize(
    "overrides, budget, where",
    [
        (ENDLESS, "3", "after {n} of 20000000 steps; the same command begins anew"),
        (["surface.n_vertices=20000"], "0.1", "in the stage mesh"),
    ],
)
def test_a_budget_stops_several_processes_after_the_same_step(overrides, budget, where, tmp_path):
    assert solve("bar_swing.toml", tmp_path, overrides, 2, ("--budget", budget)).returncode == 2
    record = json.loads((tmp_path / "run.json").read_text())
    assert record["status"] == "stopped_early"
    n = len((tmp_path / "curves.csv").read_text().splitlines()) - 2 if "{n}" in where else 0
    assert record["reason"] == "its budget of time was spent " + where.format(n=n)
    written = [len(list((tmp_path / "frames").glob(f"*_{process}.vtu"))) for process in (0, 1)]
    assert written[0] == written[1] >= (2 if n else 0)


def test_several_processes_find_the_stable_step_of_one(tmp_path):
    overrides = [*EXPLICIT, "surface.n_vertices=100", "time.step=0", "time.end=1e-3"]
    one, several = (run("bar_swing.toml", tmp_path / str(p), overrides, p) for p in (1, 3))
    assert several.record["step"] == pytest.approx(one.record["step"], rel=1e-3)


@pytest.mark.parametrize("scene", ["bar_sag.toml", "bar_bend.toml"])
def test_each_process_holds_a_third_of_the_body_at_most_and_iterations_stay(scene, tmp_path):
    def memory(found):
        return np.array(
            found.record.get("of_processes", {}).get("peak_memory", [found.record["peak_memory"]])
        )

    overrides = ["reference.degree=2", "time.load_steps=1", "gravity=[0,-1,0]", "surface.n_vertices={}"]
    whole, small = (
        [
            run(scene, tmp_path / f"{n}_{size}", [*overrides[:-1], overrides[-1].format(size)], n)
            for n in (1, 4)
        ]
        for size in (4000, 100)
    )
    of_body = [memory(large) - memory(little) for large, little in zip(whole, small, strict=True)]
    assert of_body[1].max() < of_body[0].max() / 3
    iterations = [found.record["linear_iterations"] for found in whole]
    assert iterations[1] <= 1.25 * iterations[0]


def test_seconds_of_a_process_are_parted_into_those_without_and_within_mpi(tmp_path):
    """Both together are all that the first process has taken."""
    record = run("bar_sag.toml", tmp_path, ["surface.n_vertices=1000", "reference.degree=2"], 3).record
    without, within = (record["of_processes"][name] for name in ("cpu", "cpu_in_mpi"))
    assert min(without + within) > 0
    all_of_it = record["seconds"]["start-up"] + record["cpu"]
    assert without[0] + within[0] == pytest.approx(all_of_it, abs=within[0] / 2)


def test_convergence_is_studied_by_several_processes(tmp_path):
    records = [
        run("bar_sag.toml", tmp_path / str(n), ["surface.n_vertices=100"], n, ("--converge", "2")).record[
            "convergence"
        ]
        for n in (1, 2)
    ]
    assert records[1]["estimated_error_l2"] == pytest.approx(records[0]["estimated_error_l2"], rel=1e-6)


def test_loads_that_drive_a_free_body_are_told_with_force_and_torque(tmp_path):
    errors = []
    for n in (1, 2):
        done = solve("ball_pressure.toml", tmp_path / "out", ["gravity=[0,0,-9.81]"], n)
        assert done.returncode != 0
        errors.append([line for line in done.stderr.splitlines() if line.startswith("error:")])
    (one,), (two,) = errors
    assert one.split("net force")[0] == two.split("net force")[0] and "shift along z" in two

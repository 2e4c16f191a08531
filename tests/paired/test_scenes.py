"""The shipped scenes from end to end: both programs, the comparison, the files they leave."""

import json
import os
import subprocess
from pathlib import Path

import meshio
import numpy as np
import pytest
import pyvista as pv

from analysis.compare import (
    compare_runs,
    displacement_error,
    free_motions,
    remove_rigid_motion,
    vertex_areas,
    volume,
)
from analysis.comparison import compare
from analysis.experiment import run_solvers
from analysis.paths import PROGRAMS, ROOT
from analysis.results import write_results
from analysis.runs import load_run

SCENES = ROOT / "analysis" / "scenes"


def run_pair(name: str, folder: Path, *overrides: str):
    return run_solvers(SCENES / f"{name}.toml", folder, None, list(overrides), is_quiet=True)


def test_ball_pressure(tmp_path):
    experiment = run_pair("ball_pressure", tmp_path, "time.residual=1e-13")
    comparison = write_results(experiment)
    assert comparison["status"] == "ok"
    folders = [experiment.reference_folder, *map(experiment.massspring_folder, LAST_SEEN)]
    assert len({load_run(folder).record["problem_hash"] for folder in folders}) == 1

    # u = -(1 - 2 nu) p x / E is in the finite elements' space, so what is left is the linear solver's tolerance.
    material, pressure = experiment.scene["material"], experiment.scene["loads"][0]["pressure"]
    shrinkage = (1 - 2 * material["nu"]) * pressure / material["E"]
    frame = load_run(experiment.reference_folder).last
    weights = vertex_areas(frame.X, frame.F)
    exact = remove_rigid_motion(frame.X, -shrinkage * frame.X, weights)
    u = remove_rigid_motion(frame.X, frame.u, weights)
    assert np.abs(u - exact).max() < 1e-8 * np.abs(exact).max()
    assert frame.X.mean(axis=0) == pytest.approx([0, 0, 0], abs=1e-12)

    # Tetrahedra hold the uniform field, so that what is left is rounding, whatever the mesh.
    for name in ("node_averaged", "edge_coupled"):
        model = comparison["models"][name]
        assert model["n_floppy_motions"] == 0
        for key in ("displacement_error_l2", "displacement_error_max", "volume_change_error"):
            assert model[key] < 1e-10, (name, key)
    check_drift(comparison)


def test_default_scene_tells_averaged_strain_from_the_papers_network(tmp_path):
    """At a large strain, where both find a balance; under more pressure the paper's network finds none."""
    few = "surface.n_vertices=300"
    comparison = write_results(run_pair("torus_inflates", tmp_path, few))
    assert comparison["status"] == "ok"
    assert comparison["reference"]["largest_volume_change"] > 0.3
    errors = {name: model["displacement_error_l2"] for name, model in comparison["models"].items()}
    assert errors["node_averaged"] < 0.05 < 0.8 < errors["uniform"]
    for model, status in (("node_averaged", 0), ("uniform", 2)):
        command = [PROGRAMS / "massspring", SCENES / "torus_inflates.toml", "--quiet", "--no-diagnostics"]
        for override in (few, "loads.0.pressure=-4e4", f"network.calibration={model}"):
            command += ["--set", override]
        assert subprocess.run([*command, "--out", tmp_path / "more" / model]).returncode == status


def stretches_of_neo_hookean_body(E, nu, pressures):
    """Equal stretches s under dead pressure bear P(s) = mu s + (lambda (s^6 - 1) / 2 - mu) / s [Ciarlet & Geymonat 1982].

    Returns them and the energy density at each.
    """
    lame, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    low, high = np.full(len(pressures), 0.5), np.full(len(pressures), 1.5)
    for _ in range(60):
        s = (low + high) / 2
        is_low = mu * s + (lame / 2 * (s**6 - 1) - mu) / s < -pressures
        low, high = np.where(is_low, s, low), np.where(is_low, high, s)
    return low, mu / 2 * (3 * low**2 - 3) + lame / 4 * (low**6 - 1) - (mu + lame / 2) * 3 * np.log(low)


@pytest.mark.parametrize(
    "program, law",
    [("massspring", "small_strain"), ("massspring", "neo_hookean"), ("fem_reference", "small_strain")],
)
def test_curves_are_those_of_a_body_that_shrinks_evenly(tmp_path, program, law):
    pressure, n_steps = 2e3, 5  # a hundredth of strain
    command = [PROGRAMS / program, SCENES / "ball_pressure.toml", "--quiet", "--out", tmp_path]
    for override in ("surface.n_vertices=162", f"loads.0.pressure={pressure}", f"material.law={law}"):
        command += ["--set", override]
    subprocess.run(command, check=True)
    run = load_run(tmp_path)
    assert run.record["law"] == law
    E, nu, factors = 1e5, 0.25, np.linspace(0, 1, n_steps + 1)
    if law == "neo_hookean":
        stretch, density = stretches_of_neo_hookean_body(E, nu, factors * pressure)
    else:
        stretch = 1 - (1 - 2 * nu) * factors * pressure / E
        density = 3 * pressure * factors * (1 - stretch) / 2
    X, F = run.last.X, run.last.F
    rest = volume(X, F)
    area = np.linalg.norm(np.cross(X[F[:, 1]] - X[F[:, 0]], X[F[:, 2]] - X[F[:, 0]]), axis=1).sum() / 2
    expected = {
        "time": factors,
        "load_factor": factors,
        "volume": stretch**3 * rest,
        "area": stretch**2 * area,
        "kinetic_energy": 0 * factors,
        "elastic_energy": density * rest,
        "max_displacement": 1 - stretch,  # of a ball of radius 1 m around the origin
        "max_strain": 1 - stretch,
    }
    if law == "neo_hookean":
        expected |= {"min_J": stretch**3, "min_J_nodes": stretch**3}
    assert list(run.curves) == list(expected)
    for name, values in expected.items():
        rel = (
            0.01 if name == "max_displacement" else 1e-5
        )  # springs shrink towards a point near the ball's centre
        assert run.curves[name] == pytest.approx(values, rel=rel, abs=1e-9), name


@pytest.mark.parametrize("model, n_corners", [("uniform", 2), ("node_averaged", 4)])
def test_strain_is_that_of_what_the_frames_hold(model, n_corners, tmp_path):
    """Springs have their own strain and lines in the frames, coupled ones that of their tetrahedra, and no lines."""
    command = [
        PROGRAMS / "massspring",
        SCENES / "bar_sag.toml",
        "--quiet",
        "--out",
        tmp_path,
        "--no-diagnostics",
    ]
    for override in ("surface.n_vertices=200", "output.frames_every=1", f"network.calibration={model}"):
        command += ["--set", override]
    subprocess.run(command, check=True)
    run = load_run(tmp_path)
    assert [name for name in run.curves if "strain" in name] == [_STRAINS[n_corners]]
    largest = []
    for file in run.files:
        grid = pv.read(file)
        cells = {len(corners[0]): corners for corners in grid.cells_dict.values()}
        assert set(cells) == {3, n_corners}
        X, u = (grid[name].astype(float)[cells[n_corners]] for name in ("rest_position", "displacement"))
        largest.append(_STRAIN_OF[n_corners](X + u, X).max())
    assert run.curves[_STRAINS[n_corners]] == pytest.approx(largest, rel=1e-4, abs=1e-12)


def strain_of_springs(x, X):
    now, rest = (np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) for ends in (x, X))
    return np.abs(now / rest - 1)


def strain_of_tetrahedra(x, X):
    """The principal strain of small displacements that is furthest from 0."""
    now, rest = (np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2) for corners in (x, X))
    F = now @ np.linalg.inv(rest)
    return np.abs(np.linalg.eigvalsh((F + np.swapaxes(F, 1, 2)) / 2 - np.eye(3))).max(axis=1)


_STRAINS = {2: "max_spring_strain", 4: "max_strain"}
_STRAIN_OF = {2: strain_of_springs, 4: strain_of_tetrahedra}


# A guard against drift, and no more: what this code gave when last looked at, which may be wrong. Errors of displacement
# (L2, largest) and of volume of one random network, which every machine builds alike, and its floppy motions.
LAST_SEEN = {
    "affine": (1.01191, 1.81765, 0.938781, 8),
    "uniform": (1.25299, 2.71281, 1.082526, 8),
}


def check_drift(comparison):
    assert list(comparison["models"]) == ["node_averaged", "edge_coupled", *LAST_SEEN]
    errors = ("displacement_error_l2", "displacement_error_max", "volume_change_error")
    for name, (*expected, n_floppy) in LAST_SEEN.items():
        model = comparison["models"][name]
        assert [model[key] for key in errors] == pytest.approx(expected, rel=0.01), name
        assert model["n_floppy_motions"] == n_floppy, name
    for name, model in comparison["models"].items():
        assert (model["n_springs"], model["n_patches"] > 0) == (
            (8155, False) if name in LAST_SEEN else (0, True)
        ), name
    assert comparison["n_nodes"] == 1300
    assert comparison["n_dofs_reference"] == pytest.approx(26694, rel=0.02)
    assert comparison["reference"]["largest_displacement"] == pytest.approx(1e-3, rel=1e-8)
    assert comparison["reference"]["estimated_error_l2"] < 1e-9


def test_bar_sag(tmp_path):
    experiment = run_pair("bar_sag", tmp_path, "comparison.calibrations=[]")
    comparison = write_results(experiment)
    assert comparison["status"] == "ok"

    # Timoshenko's cantilever under its own weight; clamping the whole end face stiffens it by about a per cent.
    length, height, _ = experiment.scene["surface"]["size"]
    material = experiment.scene["material"]
    E, nu, weight = material["E"], material["nu"], 9.81 * material["rho"]
    shear = E / (2 * (1 + nu)) * 10 * (1 + nu) / (12 + 11 * nu)
    sag = weight * length**4 * 1.5 / (E * height**2) + weight * length**2 / (2 * shear)
    assert comparison["reference"]["largest_displacement"] == pytest.approx(sag, rel=0.02)

    # Measured 0.118 %; one step coarser in the interior doubles it.
    assert 0.0009 < comparison["displacement_error_l2"] < 0.0016


def test_a_bar_of_twelve_triangles_is_cut_until_it_bends(tmp_path):
    surface, sags = tmp_path / "bar.ply", {}
    length, E, nu, weight = 8, 1e8, 0.25, 9.81 * 1000
    pv.Box((0, length, 0, 1, 0, 1)).triangulate().clean().save(surface)
    for across in (0, 1):
        command = [PROGRAMS / "massspring", SCENES / "bar_sag.toml", "--quiet", "--out", tmp_path]
        command += ["--set", f'surface={{file="{surface}", across={across}}}']
        subprocess.run(command, check=True)
        run = load_run(tmp_path)
        assert len(run.last.X) == 8 + run.record.get("n_cut", 0)
        assert ("n_cut" in run.record) == bool(across)
        sags[across] = run.curves["max_displacement"][-1]
    shear = E / (2 * (1 + nu)) * 10 * (1 + nu) / (12 + 11 * nu)
    sag = weight * length**4 * 1.5 / E + weight * length**2 / (2 * shear)  # Timoshenko's cantilever
    assert sags[0] < 0.1 * sag
    assert sags[1] == pytest.approx(sag, rel=0.015)


@pytest.mark.parametrize("thickness, is_estimated", [(0.004, False), (0.1, True)])
def test_of_a_plate_whose_edges_are_far_longer_than_it_is_thick_no_error_is_estimated(
    tmp_path, thickness, is_estimated
):
    """Springs lock there on a finer network, too, and their distance is a part of the error."""
    keys = ["surface.n_vertices=60", f"surface.size=[1, 1, {thickness}]", "surface.across=0"]
    words = [word for key in keys for word in ("--set", key)]
    scene = ROOT / "analysis" / "scenes" / "bar_sag.toml"
    command = [str(PROGRAMS / "massspring"), str(scene), *words, "--no-diagnostics", "--out", str(tmp_path)]
    subprocess.run(command, check=True, capture_output=True)
    record = json.loads((tmp_path / "run.json").read_text())
    assert ("estimated_error" in record) == is_estimated
    if not is_estimated:
        assert "times as long as the body is thick" in record["not_estimated"]


def test_a_beam_whose_corners_are_all_clamped_is_compared_between_them(tmp_path):
    """Its file has no vertex that moves."""
    surface, scene = tmp_path / "beam.ply", tmp_path / "beam.toml"
    pv.Box((0, 8, 0, 1, 0, 1)).triangulate().clean().save(surface)
    ends = [
        f"region = {{ box = {{ low = [{x}, 0, 0], high = [{x}, 1, 1] }}, relative = true }}" for x in (0, 1)
    ]
    supports = "".join(f"[[supports]]\n{end}\n" for end in ends)
    material = 'E = 1e8\nlaw = "small_strain"'
    scene.write_text(
        f'gravity = [0, -9.81, 0]\n[surface]\nfile = "beam.ply"\n[material]\n{material}\n{supports}'
    )
    comparison = write_results(run_solvers(scene, tmp_path / "out", None, [], is_quiet=True))
    assert comparison["status"] == "ok"
    reference = comparison["reference"]
    assert reference["n_points"] > 100
    # A clamped beam under its weight, with shear: q L^4 / 384 EI + q L^2 / 8 G kA.
    bending, shear = 9810 * 8**4 * 12 / (384 * 1e8), 9810 * 8**2 / (8 * 4e7 * 10 * 1.25 / 14.75)
    assert reference["largest_displacement"] == pytest.approx(bending + shear, rel=0.03)
    assert comparison["displacement_error_l2"] < 0.01


def test_torus_hang(tmp_path):
    comparison = write_results(run_pair("torus_hang", tmp_path, "comparison.calibrations=[]"))
    assert comparison["status"] == "ok"
    # Measured 1.52 %, where the reference's own error is some 5 %: a clamp with a jagged edge.
    assert 0.0121 < comparison["displacement_error_l2"] < 0.0202


def gear(n_teeth=10, height=1.0, edge=1e-3):
    """A gear whose teeth have corners of two points, `edge` apart: the triangles between its faces are needles."""
    ring = []
    for tooth in range(n_teeth):
        for turn, radius in ((0.1, 0.8), (0.3, 1.0), (0.7, 1.0), (0.9, 0.8)):
            ring += [((tooth + turn) * 2 * np.pi / n_teeth + side * edge / 2, radius) for side in (-1, 1)]
    n = len(ring)
    rings = [[(r * np.cos(a), r * np.sin(a), z) for a, r in ring] for z in (0, height)]
    bores = [[(0.3 * np.cos(a), 0.3 * np.sin(a), z) for a, _ in ring] for z in (0, height)]
    low, high, low_bore, high_bore = (part * n + np.arange(n) for part in range(4))
    faces = []
    for a, b in ((low, high), (high, high_bore), (high_bore, low_bore), (low_bore, low)):
        faces += [(a[k], a[k - n + 1], b[k - n + 1]) for k in range(n)]
        faces += [(a[k], b[k - n + 1], b[k]) for k in range(n)]
    return np.concatenate([*rings, *bores]), np.array(faces)


def test_gear_of_needles_is_solved_by_both_programs(tmp_path):
    X, F = gear()
    a, b, c = (X[F[:, k]] for k in range(3))
    longest = np.max([np.linalg.norm(p - q, axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    assert (longest**2 / (2 * area)).max() > 1e3  # over the least height
    file = tmp_path / "gear.off"
    rows = [" ".join(map(repr, map(float, x))) for x in X] + [f"3 {i} {j} {k}" for i, j, k in F]
    file.write_text(f"OFF\n{len(X)} {len(F)} 0\n" + "\n".join(rows) + "\n")

    few = (f"surface.file={file}", "surface.shape=", "surface.across=0", "comparison.calibrations=[]")
    comparison = compare(run_pair("sag", tmp_path / "out", *few), is_as_in_scene=True).as_json()
    assert comparison["status"] == "ok"
    assert (
        comparison["models"]["node_averaged"]["displacement_error_l2"] < 0.4
    )  # 0.24 on one machine, below 0.2 on others
    for folder in (tmp_path / "out").rglob("run.json"):
        record = json.loads(folder.read_text())
        assert record["mesher"], folder
        assert 0 < record["tetrahedra"]["min_radius_ratio"] < 0.01, folder


def test_sag_is_free_of_scale(tmp_path):
    """The same body in other units of length gives the same figures."""

    # How often the reference would be refined further hangs on how busy the machine is.
    def result(name, *overrides):
        few = ["surface.n_vertices=600", "comparison.calibrations=[]", *overrides]
        return write_results(
            run_solvers(SCENES / "sag.toml", tmp_path / name, None, few, is_quiet=True, is_refined_once=True)
        )

    one, other = result("one"), result("other", "surface.scale=1024.0")
    assert one["status"] == "ok"
    # A power of two rounds nothing, so not even the mesh may differ.
    assert other["displacement_error_l2"] == pytest.approx(one["displacement_error_l2"], rel=1e-6)


def test_filled_in_scene_reproduces_the_run_and_nothing_runs_twice(tmp_path):
    few = ["surface.n_vertices=162", "comparison.calibrations=[]"]
    first = run_pair("ball_pressure", tmp_path / "first", *few)
    records = [first.reference_folder / "run.json", first.massspring_folder(first.calibration) / "run.json"]
    written = [file.stat().st_mtime_ns for file in records]
    run_pair("ball_pressure", tmp_path / "first", *few)
    assert [file.stat().st_mtime_ns for file in records] == written

    again = run_solvers(first.folder / "scene.toml", tmp_path / "again", None, [], is_quiet=True)
    for one, other in zip(
        records,
        [again.reference_folder / "run.json", again.massspring_folder(again.calibration) / "run.json"],
        strict=True,
    ):
        assert json.loads(one.read_text())["input_hash"] == json.loads(other.read_text())["input_hash"]
    assert (load_run(first.reference_folder).last.u == load_run(again.reference_folder).last.u).all()


def test_changed_list_of_models_is_seen_by_a_finished_experiment(tmp_path):
    few = ["surface.n_vertices=162"]
    run_pair("ball_pressure", tmp_path, *few, "comparison.calibrations=[]")
    experiment = run_pair("ball_pressure", tmp_path, *few, 'comparison.calibrations=["edge_coupled"]')
    assert (experiment.massspring_folder("edge_coupled") / "run.json").exists()


def test_springs_give_the_same_bits_on_one_thread_and_two(tmp_path):
    frames = []
    for n_threads in ("1", "2"):
        out = tmp_path / n_threads
        command = [
            PROGRAMS / "massspring",
            SCENES / "bar_sag.toml",
            "--out",
            out,
            "--quiet",
            "--no-diagnostics",
        ]
        threads = {"OMP_NUM_THREADS": n_threads, "OPENBLAS_NUM_THREADS": n_threads}
        subprocess.run(command, check=True, env={**os.environ, **threads})
        frames.append(load_run(out).last.u)
    assert np.abs(frames[0]).max() > 0
    assert (frames[0] == frames[1]).all()


# A guard against drift, and no more: relative error under end shear and collapse of a ball of 162 vertices as this code
# gave it when last looked at. No other program has these models; test_edge_coupled has linear elements' stiffness.
ACCURACY_LAST_SEEN = {
    "uniform": (0.464205, 0.0393813),
    "affine": (0.444491, 0.0371714),
    "van_gelder": (0.150241, 0.0333397),
    "lloyd": (0.145562, 0.0343727),
    "moment": (0.0715485, 0.047708),
    "edge_coupled": (0.12073, 0.00807788),
    "node_averaged": (0.0528984, 0.00415408),
}


@pytest.mark.parametrize("load", ["end_shear", "collapse"])
def test_accuracy_of_loads_without_an_exact_field(load, tmp_path):
    scene = Path(__file__).with_name(f"{load}.toml")

    def run(program: str, *words: str):
        out = tmp_path / "-".join([program, *words])
        command = [PROGRAMS / program, scene, "--quiet", "--out", out]
        subprocess.run([*command, "--set", words[0]], check=True)
        return load_run(out)

    coarse, fine = (run("fem_reference", f"reference.refine={refine}") for refine in (0, 1))
    for model, errors in ACCURACY_LAST_SEEN.items():
        found = compare_runs(run("massspring", f"network.calibration={model}"), fine, is_free=True)
        expected = errors[load == "collapse"]
        assert found.displacement_error_l2 == pytest.approx(expected, rel=0.01), model
    if load == "end_shear":
        own = compare_runs(coarse, fine, is_free=True).displacement_error_l2
        assert own == pytest.approx(0.01172, rel=0.05)


def test_reference_stops_at_its_tolerance(tmp_path):
    runs = []
    for tolerance in ("1e-10", "1e-3"):
        command = [
            PROGRAMS / "fem_reference",
            SCENES / "bar_sag.toml",
            "--quiet",
            "--out",
            tmp_path / tolerance,
        ]
        subprocess.run([*command, "--set", f"time.residual={tolerance}"], check=True)
        runs.append(load_run(tmp_path / tolerance))
    exact, loose = runs
    assert exact.record["residual"] <= 1e-10 == exact.record["tolerance"]
    assert 1e-6 < loose.record["residual"] <= 1e-3 == loose.record["tolerance"]
    assert loose.record["linear_iterations"] < exact.record["linear_iterations"]
    difference = np.abs(loose.last.u - exact.last.u).max() / np.abs(exact.last.u).max()
    assert 0 < difference < 1e-3  # as the residual


CUBE = """
[surface]
shape = "bar"
n_vertices = 98
size = [1, 1, 1] # m

[material]
E = 1e5 # Pa
nu = 0.3
damping = 20 # 1/s
law = "neo_hookean"
"""
PLATES = """
[[obstacles]]
plane = { point = [0, 0, 0], normal = [0, 1, 0] }

[[obstacles]]
plane = { point = [0, 1, 0], normal = [0, -1, 0] }
motion = [[0, 0, 0, 0], [0.5, 0, -DEPTH, 0]]

[time]
mode = "dynamic"
step = 0.01 # s
end = 2 # s

[output]
frames_every = 0
"""
PRESCRIBED = """
[[supports]]
region = { plane = { point = [0, 0.001, 0], normal = [0, 1, 0] } }
components = "y"

[[supports]]
region = { plane = { point = [0, 0.999, 0], normal = [0, -1, 0] } }
components = "y"
displacement = [0, -DEPTH, 0] # m

[time]
load_steps = 2
"""


@pytest.mark.parametrize("depth", ["0.01", "0.05"])
def test_cube_between_plates(tmp_path, depth):
    """Springs pressed by contact come to rest where prescribed motion of the plates takes the finite elements."""
    runs = []
    for program, scene in (("massspring", PLATES), ("fem_reference", PRESCRIBED)):
        file, out = tmp_path / f"{program}.toml", tmp_path / program
        file.write_text(CUBE + scene.replace("DEPTH", depth))
        subprocess.run([PROGRAMS / program, file, "--quiet", "--out", out], check=True)
        runs.append(load_run(out))
    springs, reference = (run.last for run in runs)
    error = displacement_error(reference.X, reference.F, springs.u, reference.u, is_free=True)
    assert error.l2 < 1e-6  # of what damping leaves after two seconds; the field is homogeneous
    assert np.abs((springs.X + springs.u)[:, 1].max() - 1 + float(depth)) < 1e-12


BENT = """
[surface]
shape = "bar"
n_vertices = 120
size = [2, 0.5, 0.5] # m

[material]
E = 1e6 # Pa
nu = 0.3

[[loads]]
stress = [[0, 0, 1, 1e3, 0, 0, 0, 0, 0], [0, 0, 0, -250, 0, 0, 0, 0, 0]] # Pa: 1e3 (z - 0.25) along x

[time]
load_steps = 1
"""


def test_bending_by_a_stress_field(tmp_path):
    """Tractions of a linear stress field bend a body exactly in quadratic elements, and nearly so in springs."""
    file = tmp_path / "bent.toml"
    file.write_text(BENT)
    experiment = run_solvers(file, tmp_path / "out", None, [], is_quiet=True)
    frame = load_run(experiment.reference_folder).last
    x, y, z = (frame.X - [1, 0.25, 0.25]).T
    curvature, nu = 1e3 / 1e6, 0.3
    exact = curvature * np.stack([x * z, -nu * y * z, -(x**2 + nu * z**2 - nu * y**2) / 2], axis=1)
    assert displacement_error(frame.X, frame.F, frame.u, exact, is_free=True).max < 1e-8
    assert write_results(experiment)["displacement_error_l2"] < 0.02


MOVED = """
[surface]
shape = "bar"
n_vertices = 98
size = [1, 1, 1] # m

[material]
E = 1e5 # Pa
nu = 0.3
law = "neo_hookean"

[[supports]]
region = { plane = { point = [0, 0.001, 0], normal = [0, 1, 0] } }
components = "y"

[[supports]]
region = { plane = { point = [0, 0.999, 0], normal = [0, -1, 0] } }
components = "y"
motion = [[0, 0, 0, 0], [0.4, 0, -0.1, 0], [1, 0, 0.05, 0]] # s or load factor, m

[network]
calibration = "edge_coupled"
"""


def test_damping_of_a_ratio_is_the_same_in_both_programs(tmp_path):
    overrides = (
        "material.damping_ratio=0.1",
        "time.end=0.032",
        "comparison.calibrations=[]",
    )
    experiment = run_pair("bar_swing", tmp_path, *overrides)
    springs, reference = (
        load_run(experiment.massspring_folder("node_averaged")),
        load_run(experiment.reference_folder),
    )
    # Masses at nodes would make it 0.3 % less.
    assert springs.record["mass_damping"] == pytest.approx(reference.record["mass_damping"], rel=2e-3)
    furthest = [run.curves["max_displacement"].max() for run in (springs, reference)]
    assert furthest[0] == pytest.approx(furthest[1], rel=0.01)


@pytest.mark.parametrize("mode", ["static", "dynamic"])
def test_supports_follow_their_motion(mode, tmp_path):
    """Both solvers take prescribed motion in time, and deform alike where the field is linear in space."""
    file = tmp_path / "moved.toml"
    file.write_text(MOVED)
    options = [f"time.mode={mode}", "time.step=0.02", "time.integrator=midpoint", "reference.degree=1"]
    experiment = run_solvers(file, tmp_path / "out", None, options, is_quiet=True)
    runs = [load_run(experiment.reference_folder), load_run(experiment.massspring_folder("edge_coupled"))]
    assert runs[1].record["tolerance"] == 1e-10
    assert runs[0].record["is_free"]  # along the plates
    for time in (0.2, 0.4, 0.7, 1):
        frames = [run.frame(int(np.argmin(abs(run.times - time)))) for run in runs]
        moved = np.interp(time, [0, 0.4, 1], [0, -0.1, 0.05])
        for frame in frames:
            assert frame.u[frame.X[:, 1] > 0.999, 1] == pytest.approx(moved, abs=1e-12)
        if mode == "static":
            for run in runs:
                free = free_motions(run.record)
                error = displacement_error(frames[0].X, frames[0].F, frames[1].u, frames[0].u, free)
                assert free.shape == (3, 6) and error.l2 < 1e-6


def test_frames_are_read_by_meshio_and_hold_the_rest_positions(tmp_path):
    words = ["--set", "surface.n_vertices=162", "--set", "time.load_steps=2"]
    for program in ("massspring", "fem_reference"):
        out = tmp_path / program
        command = [PROGRAMS / program, SCENES / "ball_pressure.toml", "--quiet", "--out", out, *words]
        subprocess.run(command, check=True)
        rest, end = (meshio.read(out / "frames" / f"frame_00000{step}.vtu") for step in (0, 2))
        assert (end.point_data["rest_position"] == rest.points).all()
        assert (end.point_data["rest_position"] + end.point_data["displacement"] == end.points).all()
        # Exact: u = -(1 - 2 nu) p x / E = -0.001 x, but for a rigid motion, which no difference along an edge of x has.
        triangles = end.cells_dict["triangle"]
        edges = [mesh.points[triangles[:, 1]] - mesh.points[triangles[:, 0]] for mesh in (rest, end)]
        lengths, before = (np.linalg.norm(edge, axis=1) for edge in edges[::-1])
        assert lengths / before == pytest.approx(np.full(len(triangles), 0.999), abs=1e-6)


@pytest.mark.parametrize("mode", ["static", "dynamic"])
def test_supports_of_any_direction_give_both_programs_one_problem(tmp_path, mode):
    """A bar on an incline that its far side may only slide along; what is left is discretisation."""
    scene = tmp_path / "incline.toml"
    scene.write_text(f"""gravity = [0, -9.81, 0]
[surface]
shape = "bar"
n_vertices = 300
[[supports]]
region = {{ box = {{ low = [0, 0, 0], high = [1, 0, 1] }}, relative = true }}
normal = [1, 2, 0]
[[supports]]
region = {{ box = {{ low = [0, 0, 0], high = [0, 1, 1] }}, relative = true }}
along = [1, 2, 0]
[time]
mode = "{mode}"
end = 0.1
""")
    runs = []
    for program in ("massspring", "fem_reference"):
        subprocess.run([PROGRAMS / program, scene, "--quiet", "--out", tmp_path / program], check=True)
        runs.append(load_run(tmp_path / program))
    assert len({run.record["problem_hash"] for run in runs}) == 1
    springs, elements = (run.last for run in runs)
    assert displacement_error(elements.X, elements.F, springs.u, elements.u, False).l2 < 0.04
    is_below = np.isclose(elements.X[:, 1], elements.X[:, 1].min())
    for u in (springs.u, elements.u):
        assert np.abs(u[is_below] @ [1, 2, 0]).max() < 1e-12

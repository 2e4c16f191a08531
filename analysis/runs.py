"""Reads what a solver left on disk: frames.pvd, curves.csv, run.json (written by meshing/record.h)."""

from __future__ import annotations

import csv
import json
import tomllib
import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pyvista as pv

from .machine import has_waited
from .methods import REFERENCE
from .outputs import is_as_written

Array = np.ndarray
_KEPT = 1_000_000  # points, of the frames of a run that are kept in memory: some 100 MB
SOLVED, REFUSED, NOT_OK, NOT_MODELLED = range(4)  # exit statuses of both programs: meshing/exit_status.h
STOPPED_EARLY = "stopped_early"  #: status of one that reached its budget: meshing/record.h
STRAIN_TOO_LARGE = "strain_too_large"  #: status of one that is not of small strain: meshing/algebra/status.h
LATE = 124  #: of one that was stopped for its time, as timeout(1) has it


class RunError(Exception):
    """A run that cannot be used; the message names the file and what is wrong with it.

    is_told: a program has printed the error already, so that a second line would say no more.
    """

    def __init__(self, message: str, is_told: bool = False) -> None:
        super().__init__(message)
        self.is_told = is_told


class StoppedEarlyError(RunError):
    """Not enough is there to go on with, as a budget of time was spent."""


@dataclass(frozen=True)
class Frame:
    """The surface at one moment: rest points X and displacement u, both (n_surface, 3) in m, triangles F."""

    X: Array
    u: Array
    F: Array


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points (n, 3) of a surface, in m, with triangles F of their own: each is a mean of a triangle's corners."""

    X: Array
    F: Array
    corners: Array  #: (n, 3) vertices of the surface
    weights: Array  #: (n, 3)

    def of(self, values: Array) -> Array:
        """A field (n_vertices, 3) at the points, linear on each triangle."""
        return np.einsum("pc,pcd->pd", self.weights, values[self.corners])

    def frame(self, frame: Frame) -> Frame:
        return Frame(self.X, self.of(frame.u), self.F)


@dataclass(frozen=True, eq=False)
class Run:
    """One solver's finished run.

    times: time of each frame (s; static scenes: load factor); curves: column name -> values, SI units; stopped: why a
    static run ended on its way, "" for one that did not: what it holds is then what it reached in balance; points: of the
    surface at which frames are given, in place of its own vertices.
    """

    folder: Path
    record: dict[str, Any]
    curves: dict[str, Array]
    times: Array
    files: tuple[Path, ...]
    stopped: str = ""
    points: SurfacePoints | None = None

    @cached_property
    def last(self) -> Frame:
        return self.frame(-1)

    @property
    def has_waited(self) -> bool:
        """For a core or a disk, as machine.has_waited; of results of other programs that is not known."""
        return "cpu" in self.record and has_waited(self.record["cpu"], self.record["wall"])

    @cached_property
    def widest(self) -> int:
        """Number of the frame with the largest displacement."""
        return int(np.argmax([np.linalg.norm(self.frame(k).u, axis=1).max() for k in range(len(self.times))]))

    def file(self, index: int) -> Path:
        """Of a frame. Raises RunError where it or a piece of it is missing or another than run.json lists."""
        file = self._checked(self.files[index])
        for piece in _pieces(file):
            self._checked(piece)
        return file

    def _checked(self, file: Path) -> Path:
        return _checked(self.folder, file.relative_to(self.folder).as_posix(), self.record)

    def grid(self, index: int) -> pv.UnstructuredGrid:
        """All nodes and cells of a frame, of one piece or several. Raises RunError as file does."""
        pieces = [pv.read(piece) for piece in _pieces(self.file(index))]
        return pieces[0] if len(pieces) == 1 else _joined(pieces)

    def frame(self, index: int) -> Frame:
        """The surface of one frame. Raises RunError for a missing, foreign, unreadable or non-finite file."""
        number = index % len(self.files)
        if number in self._kept:
            return self._kept[number]
        frame = self._read(_pieces(self.file(number))[0])  # which has the surface
        if self.points:
            frame = self.points.frame(frame)
        if len(self._kept) * len(frame.X) < _KEPT:
            self._kept[number] = frame
        return frame

    @cached_property
    def _kept(self) -> dict[int, Frame]:
        return {}

    @staticmethod
    def _read(file: Path) -> Frame:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a damaged file, of which more is said below
            grid = pv.read(file)
        if (
            not {"displacement", "rest_position"} <= set(grid.point_data)
            or "n_surface" not in grid.field_data
        ):
            raise RunError(f"{file}: expected 'displacement', 'rest_position' and field data 'n_surface'")
        n = int(grid.field_data["n_surface"][0])
        X, u = (np.asarray(grid[name], dtype=float)[:n] for name in ("rest_position", "displacement"))
        F = np.asarray(grid.cells_dict.get(pv.CellType.TRIANGLE, np.empty((0, 3))), dtype=int)
        if not (np.isfinite(u).all() and np.isfinite(X).all()):
            raise RunError(f"{file}: displacement is not finite")
        if not len(F) or F.max() >= n:
            raise RunError(f"{file}: expected the triangles of {n} surface nodes")
        return Frame(X, u, F)


def _pieces(file: Path) -> list[Path]:
    """The files of a frame that several processes wrote; of one that one wrote itself."""
    if file.suffix != ".pvtu":
        return [file]
    return [file.parent / piece.attrib["Source"] for piece in ElementTree.parse(file).iter("Piece")]


def _joined(pieces: list[pv.UnstructuredGrid]) -> pv.UnstructuredGrid:
    """The grid of which each has a part: nodes by their numbers there, cells by their kinds."""
    numbers = [np.asarray(piece["node_id"]) for piece in pieces]
    _, first = np.unique(np.concatenate(numbers), return_index=True)
    kinds = {kind for piece in pieces for kind in piece.cells_dict}
    cells = {
        kind: np.concatenate(
            [
                number[piece.cells_dict[kind]]
                for number, piece in zip(numbers, pieces, strict=True)
                if kind in piece.cells_dict
            ]
        )
        for kind in sorted(kinds)
    }
    whole = pv.UnstructuredGrid(cells, np.concatenate([piece.points for piece in pieces])[first])
    for name in pieces[0].point_data:
        whole[name] = np.concatenate([piece[name] for piece in pieces])[first]
    return whole


def built(folder: Path, program: str) -> Path:
    """The program's file. Raises RunError where it has not been built."""
    if not (folder / program).exists():
        raise RunError(f"{folder / program}: not built; ./testbed run builds the programs")
    return folder / program


def outcome_of(record: dict[str, Any]) -> str:
    """How a run ended, by its record: the status and, where there is one, the reason."""
    return ", ".join(part for part in (record.get("status"), record.get("reason")) if part)


def load_run(folder: Path | str, may_stop: bool = False) -> Run:
    """Opens a finished run. Raises RunError when it is half-written, damaged or holds NaN.

    may_stop: a static run that did not converge is taken as far as it came, if it came anywhere.
    """
    folder = Path(folder)
    record = record_of(folder)
    is_ok = record.get("status") == "ok"
    if not is_ok and not may_stop:
        raise RunError(f"{folder}: status is '{record.get('status')}', expected 'ok'")
    run = load_frames(folder)
    return run if is_ok else _until_it_stopped(run)


def load_frames(folder: Path) -> Run:
    """What a finished run left, however it ended. Raises RunError when it is damaged or a curve is not finite."""
    record = record_of(folder)
    if not (folder / "curves.csv").exists() and "curves.csv" not in record.get("outputs", {}):
        raise RunError(f"{folder / 'curves.csv'}: missing; the comparison needs output.curves = true")
    times, files = _read_pvd(_checked(folder, "frames.pvd", record))
    return Run(folder, record, _read_curves(_checked(folder, "curves.csv", record)), times, files)


def record_of(folder: Path) -> dict[str, Any]:
    """What run.json holds. Raises RunError where it is missing or damaged."""
    file = folder / "run.json"
    if not file.is_file():
        raise RunError(f"{folder}: no run.json, the run is not finished")
    try:
        record = json.loads(file.read_text())
    except json.JSONDecodeError as error:
        raise RunError(f"{file}:{error.lineno}: not JSON: {error.msg}") from None
    except (UnicodeDecodeError, RecursionError) as error:
        raise RunError(f"{file}: not JSON: {error}") from None
    if not isinstance(record, dict) or not isinstance(record.get("outputs", {}), dict):
        raise RunError(f"{file}: expected the record of a run")
    return record


def _checked(folder: Path, name: str, record: dict[str, Any]) -> Path:
    """A file of a run, after it has been found to be the one that run.json lists."""
    if not (folder / name).is_file():
        raise RunError(f"{folder / name}: missing, run the solver again")
    if not is_as_written(folder, name, record.get("outputs", {})):
        raise RunError(f"{folder / name}: not the file that run.json lists, run the solver again")
    return folder / name


def _until_it_stopped(run: Run) -> Run:
    rows = run.curves["time"]
    # Springs leave the step that failed as their last row; the reference does not.
    reached = run.record.get("load_factor_reached", rows[-2] if len(rows) > 1 else 0)
    n = int((run.times <= reached + 1e-9).sum())
    outcome = outcome_of(run.record)
    if scene_of(run).get("time", {}).get("mode") == "dynamic" or not n or not run.times[n - 1] > 0:
        raise RunError(f"{run.folder}: {outcome}, and no load was reached before")
    curves = {name: values[rows <= reached + 1e-9] for name, values in run.curves.items()}
    return Run(run.folder, run.record, curves, run.times[:n], run.files[:n], outcome)


def method_of(run: Run) -> str:
    """fem_reference, or the name of the spring model."""
    return run.record.get("calibration", REFERENCE)


def scene_of(run: Run) -> dict[str, Any]:
    """The scene with every default filled in, as the solver left it beside its run; empty where there is none."""
    file = run.folder / "scene.toml"
    return read_toml(file) if file.exists() else {}


def read_toml(file: Path) -> dict[str, Any]:
    """The values of a scene file. Raises RunError where it is none."""
    if not file.is_file():  # pipes and devices may never end
        raise RunError(f"{file}: missing, expected the file of a scene")
    try:
        return tomllib.loads(file.read_text())
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise RunError(f"{file}: {error}") from None


def _read_pvd(file: Path) -> tuple[Array, tuple[Path, ...]]:
    try:
        sets = ElementTree.parse(file).getroot().findall("./Collection/DataSet")
    except ElementTree.ParseError as error:
        raise RunError(f"{file}: not XML: {error}") from None
    if not sets:
        raise RunError(f"{file}: holds no frame")
    return (
        np.array([float(s.attrib["timestep"]) for s in sets]),
        tuple(file.parent / s.attrib["file"] for s in sets),
    )


def _read_curves(file: Path) -> dict[str, Array]:
    try:
        names, *rows = csv.reader(file.read_text().splitlines())
        values = np.array(rows, dtype=float).reshape(len(rows), len(names))
    except ValueError as error:
        raise RunError(f"{file}: not a table of numbers: {error}") from None
    if not np.isfinite(values).all():
        row, column = np.argwhere(~np.isfinite(values))[0]
        raise RunError(f"{file}:{row + 2}: {names[column]} = {values[row, column]}, expected a number")
    curves = dict(zip(names, values.T, strict=True))
    for name in ("time", "volume", "area"):
        if name not in curves:
            raise RunError(f"{file}: no column '{name}' (found {', '.join(names)})")
    if not len(rows):
        raise RunError(f"{file}: holds no row")
    return curves

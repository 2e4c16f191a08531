"""What the runs of a scene take, told beforehand: nodes, seconds and memory.

Rates are those of runs on one core of 2020s' servers, rounded. They are meant to tell seconds from minutes and minutes from
hours: bodies differ by a factor of three.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

_NETWORK = 2.3  # nodes of a spring network over vertices of its surface
_ELEMENTS = {1: 2.2, 2: 15.0}  # nodes of the finite elements over the same, by degree
_REFINED = 8  # nodes over those of the mesh refined once

# Seconds a node, of meshing and set-up and of the solution; in motion in time, of a step.
_SET_UP = {"springs": 5e-4, "elements": 5e-5}
_STATIC = {
    ("springs", "small_strain"): 2e-4,
    ("springs", "neo_hookean"): 4e-4,
    ("elements", "small_strain"): 1.5e-4,
    ("elements", "neo_hookean"): 2e-4,
}
_STEP = {
    ("springs", "small_strain"): 1e-6,
    ("springs", "neo_hookean"): 5e-6,
    ("elements", "small_strain"): 2e-6,
    ("elements", "neo_hookean"): 1.5e-5,
}
_STEPS = 500  # of a motion whose step the programs choose

# Bytes: of a program, and a node; steps of finite elements in time hold a factor.
_PROGRAM = 2e8
_BYTES = {"springs": 1.5e4, "elements": 4e3, "elements in time": 6e4}

LONG = 300.0  #: s, from which on it is said what would take less


@dataclass(frozen=True)
class Extent:
    """Sizes of the runs of a scene, as estimated."""

    n_vertices: int  #: of the surface
    n_network: int  #: nodes of a spring network
    n_elements: int  #: nodes of the finite elements
    seconds: float  #: of all runs, without drawing
    memory: float  #: bytes, of the largest run

    @property
    def text(self) -> str:
        return (
            f"{self.n_vertices} vertices, about {_round(self.n_network)} nodes of springs and {_round(self.n_elements)} of "
            f"finite elements: {_duration(self.seconds)} and {_memory(self.memory)} on one core, roughly; their own error may "
            "take half a minute more"
        )

    def advice(self, available: float) -> str:
        """What would take less, of runs that are long or exceed the available memory (bytes); "" of others."""
        if self.memory <= available and self.seconds <= LONG:
            return ""
        too_much = (
            f"; {_memory(available)} are available, so they may be killed" if self.memory > available else ""
        )
        return (
            f"these runs are large{too_much}. --set comparison.calibrations=[] leaves out all but one spring model, "
            "./testbed remesh with --edge makes a coarser surface, reference.degree=1 takes linear elements"
        )


def extent_of(checked: str) -> Extent:
    """By what `massspring --check` prints."""
    scene = json.loads(checked)
    law, n = scene["law"], scene["n_vertices"]
    n_network = round(_NETWORK * scene["n_vertices_of_springs"])
    n_elements = round(_ELEMENTS[scene["degree"]] * n * _REFINED ** scene["refine"])
    is_static = scene["mode"] == "static"

    def seconds(method: str, n_nodes: int) -> float:
        solve = _STATIC[method, law] if is_static else scene.get("n_steps", _STEPS) * _STEP[method, law]
        return n_nodes * (_SET_UP[method] + solve)

    held = "elements" if is_static else "elements in time"
    return Extent(
        n,
        n_network,
        n_elements,
        len(scene["models"]) * seconds("springs", n_network) + seconds("elements", n_elements),
        _PROGRAM + max(n_network * _BYTES["springs"], n_elements * _BYTES[held]),
    )


def available_memory(file: Path = Path("/proc/meminfo")) -> float:
    """Bytes that a program can take."""
    lines = dict(line.split(":") for line in file.read_text().splitlines())
    return 1024 * float(lines["MemAvailable"].split()[0])


def _round(n: int) -> str:
    return f"{float(f'{n:.2g}'):,.0f}"


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{max(1, float(f'{seconds:.1g}')):.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.0f} h"


def _memory(size: float) -> str:
    return f"{size / 1e9:.1f} GB"

"""The folder of a paired experiment: what its scene says, and where its runs lie."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .compare import Free, free_motions_of
from .runs import record_of


@dataclass(frozen=True)
class Experiment:
    """A finished pair of solver runs, side by side in one folder."""

    folder: Path
    scene: dict[str, Any]  #: filled in, as the solvers read it
    failed: dict[str, str]  #: spring models that gave no result, and why
    unsolved: str = ""  #: the part of the scene that the reference does not model; "": it solved the scene
    notes: tuple[
        str, ...
    ] = ()  #: sentences for the report: what was probably not meant, what was done to the surface
    command: str = ""  #: that repeats it, without an output folder
    n_refinements: int = 0  #: of the reference, for its error
    next_reference_seconds: float | None = None  #: of the next refinement, as foreseen; None: none is needed
    unrefined: str = ""  #: why the next refinement gave nothing; "": it was not tried
    has_half_step: bool = (
        False  #: the scene's own springs, which have no reference, were run at half the step, too
    )
    seconds: float = 0  #: of wall-clock time, of all runs together

    @property
    def name(self) -> str:
        return self.scene["name"]

    @property
    def surface(self) -> str:
        """Name of the surface's file or shape."""
        return Path(self.scene["surface"].get("file", "")).name or self.scene["surface"]["shape"]

    @property
    def calibration(self) -> str:
        return self.scene["network"]["calibration"]

    @property
    def calibrations(self) -> list[str]:
        """Every spring model of the comparison, the scene's own first."""
        return list(dict.fromkeys([self.calibration, *self.scene["comparison"]["calibrations"]]))

    @property
    def law(self) -> str:
        """Of both solvers."""
        return self.scene["material"]["law"]

    @property
    def is_free(self) -> Free:
        return free_motions_of(
            self.scene, (record_of(file.parent) for file in self.folder.glob("**/run.json"))
        )

    @property
    def is_static(self) -> bool:
        return self.scene["time"]["mode"] == "static"

    def massspring_folder(self, calibration: str) -> Path:
        return self.folder / "massspring" / calibration

    @property
    def reference_folder(self) -> Path:
        return self.folder / "fem_reference"

    def refined_folder(self, n: int) -> Path:
        """Of the reference refined n times for its error."""
        return self.folder / "reference_refined" / str(n)

    @property
    def half_step_folder(self) -> Path:
        """Of the scene's own springs at half their step, where there is no reference."""
        return self.folder / "half_step"

    @property
    def reference_folders(self) -> list[Path]:
        """Of the reference as the scene has it, and refined."""
        return [self.reference_folder, *(self.refined_folder(n + 1) for n in range(self.n_refinements))]

    @property
    def target_error(self) -> float:
        """What adaptive springs are to reach; 0: they are not adapted."""
        return float(self.scene["network"].get("target_error", 0))

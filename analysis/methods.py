"""Names of what is compared: the reference, finite elements of degree 1 and 2, and the spring models by their own names."""

from __future__ import annotations

REFERENCE = "fem_reference"
FEM_P1, FEM_P2 = "fem_p1", "fem_p2"

_LABELS = {
    REFERENCE: "finite elements",
    FEM_P1: "finite elements, linear",
    FEM_P2: "finite elements, quadratic",
}


def label_of(method: str) -> str:
    return _LABELS.get(method, f"springs, {method}")

"""Names of what is compared: the reference, finite elements of degree 1 and 2, and the spring models by their own names."""

from __future__ import annotations

REFERENCE = "fem_reference"
FEM_P1, FEM_P2 = "fem_p1", "fem_p2"
FEM_P1_EXPLICIT, FEM_P2_EXPLICIT = "fem_p1, central_differences", "fem_p2, central_differences"
ELEMENTS = (FEM_P1, FEM_P2, FEM_P1_EXPLICIT, FEM_P2_EXPLICIT)

_LABELS = {
    REFERENCE: "finite elements",
    FEM_P1: "finite elements, linear",
    FEM_P2: "finite elements, quadratic",
    FEM_P1_EXPLICIT: "finite elements, linear, explicit",
    FEM_P2_EXPLICIT: "finite elements, quadratic, explicit",
}


def label_of(method: str) -> str:
    return _LABELS.get(method, f"springs, {method}")

"""The bodies drawn at random."""

from analysis.remesh import checked
from analysis.studies.bodies import Body, write_body


def test_triangles_that_cross_each_other_are_drawn_anew(tmp_path):
    """As all do that decimation gives of this body's even triangles."""
    surface = checked(write_body(Body("sheet", 3, "graded"), tmp_path))
    assert surface["usable"] and surface["self_intersections"] == 0

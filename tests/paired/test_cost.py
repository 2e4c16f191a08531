"""The cost study's scene runs with each of its parts, so that none is a row without figures."""

import pytest
from programs import ended, words_of

from analysis.studies.cost import PARTS, SCENE, STEP


@pytest.mark.parametrize("part", PARTS)
def test_each_part_of_the_cost_study_runs(part, tmp_path):
    done = ended(words_of(tmp_path, "massspring", SCENE, (f"time.end={2 * STEP}", *PARTS[part])))
    assert done.returncode == 0, done.stderr

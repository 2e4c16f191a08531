"""The last line of ./testbed test counts what ran, with the Python tests inside an entry of ctest."""

from summary import summarise

REPORT = """<testsuite>
<testcase name="Springs.Pull" status="run"><system-out>[       OK ]</system-out></testcase>
<testcase name="Springs.Push" status="fail"><system-out>[  FAILED  ]</system-out></testcase>
<testcase name="Meshes.AreRead" status="notrun"><skipped message=""/><system-out>tests/test_io.cpp:130: Skipped
no folder meshes
[  SKIPPED ]</system-out></testcase>
<testcase name="analysis" status="run"><system-out>....s
SKIPPED [1] test_pages.py:61: needs node
41 passed, 1 skipped in 3.00s
</system-out></testcase>
<testcase name="paired" status="fail"><system-out>2 failed, 3 passed, 1 error in 3.00s</system-out></testcase>
</testsuite>"""


def test_python_tests_count_one_by_one_and_skips_are_named():
    assert summarise(REPORT).splitlines() == [
        "Meshes.AreRead: SKIPPED no folder meshes",
        "analysis: SKIPPED [1] test_pages.py:61: needs node",
        "45 passed, 4 failed, 2 skipped",
    ]


def test_a_failure_of_python_before_any_test_counts():
    broken = '<testsuite><testcase name="a" status="fail"><system-out>no such file</system-out></testcase></testsuite>'
    assert summarise(broken) == "0 passed, 1 failed, 0 skipped"

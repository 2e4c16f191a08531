"""Adds up what ctest reports (a JUnit file), with the Python tests inside single entries of it, and names what was skipped."""

import re
import sys
from pathlib import Path
from xml.etree import ElementTree


def summarise(report: str) -> str:
    """The skipped tests with their reasons, then one line of counts."""
    counts = {"passed": 0, "failed": 0, "skipped": 0}
    lines = []
    for case in ElementTree.fromstring(report).iter("testcase"):
        output = case.findtext("system-out") or ""
        by_pytest = re.findall(r"(\d+) (passed|failed|error|skipped)", output.rstrip().rpartition("\n")[2])
        if by_pytest:
            for n, outcome in by_pytest:
                counts["failed" if outcome == "error" else outcome] += int(n)
            lines += [
                f"{case.attrib['name']}: {line}" for line in re.findall(r"^SKIPPED .*", output, re.MULTILINE)
            ]
        elif case.attrib["status"] == "run":
            counts["passed"] += 1
        elif case.find("skipped") is not None:
            counts["skipped"] += 1
            reason = re.search(r"^.*: Skipped\n(.*)", output, re.MULTILINE)
            lines.append(f"{case.attrib['name']}: SKIPPED {reason[1] if reason else ''}".rstrip())
        else:
            counts["failed"] += 1
    lines.append(", ".join(f"{n} {outcome}" for outcome, n in counts.items()))
    return "\n".join(lines)


if __name__ == "__main__":
    print(summarise(Path(sys.argv[1]).read_text(errors="replace")))

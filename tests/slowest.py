"""The slowest tests of some JUnit reports:  slowest.py COUNT REPORT…"""

import sys
import xml.etree.ElementTree as ElementTree

cases = []
for report in sys.argv[2:]:
    for suite in ElementTree.parse(report).getroot().iter("testsuite"):
        cases += [(float(case.get("time", 0)), suite.get("name"), case.get("name")) for case in suite.iter("testcase")]
for seconds, suite, name in sorted(cases, reverse=True)[: int(sys.argv[1])]:
    print(f"{seconds:7.1f} s  {suite} {name}")
print(f"{sum(case[0] for case in cases):7.0f} s  {len(cases)} tests together")

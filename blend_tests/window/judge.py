"""Verdict on a scenario, from its result, exit status and log. Success is never assumed."""

import re

ERROR = re.compile(r"\bError\b|\bERROR\b|EXCEPTION_|Segmentation fault")
MISCOUNTED = r"^Error: Not freed memory blocks: 4294967295, total unfreed memory 0\.000000 MB$"
"""Line that Blender may write when it quits: minus one block is nothing that was kept."""


def failures(result, status, log):
    """Faults of a scenario, a list of texts.

    `result`: the driver's result.json, None if there is none. `status`: the exit status of Blender, None if it was
    killed for taking too long. `log`: what Blender wrote.
    """
    found = []
    if result is None:
        found.append("the scenario never started")
    else:
        found += result["failures"]
        if not result["finished"] and not result["failures"]:
            found.append(f"ended in the middle of: {result['step']}")
        if result["finished"] and not result["checks"]:
            found.append("checked nothing")
    if status is None:
        found.append("killed: time is up")
    elif status != 0:
        found.append(f"Blender ended with status {status}")
    expected = result["expected"] if result else []
    shown = [line for line in result.get("errors", []) if not matches(line, expected)] if result else []
    return found + [f"Blender showed: {line}" for line in shown] + errors_in_log(log, expected)


def matches(line, patterns):
    """True if one of the regular expressions is found in a line."""
    return any(re.search(pattern, line) for pattern in patterns)


def errors_in_log(log, expected):
    """Tracebacks and errors in Blender's log, apart from lines that match one of the expected regular expressions."""
    lines = [line for line in log.splitlines() if not matches(line, [*expected, MISCOUNTED])]
    found, trace = [], None
    for line in lines:
        if line.startswith("Traceback "):
            trace = [line]
        elif trace is not None:
            trace.append(line)
            # The last line of a traceback is the first that is not indented.
            if line and not line[0].isspace():
                found.append("in the log: " + "\n".join(trace))
                trace = None
        elif ERROR.search(line):
            found.append("in the log: " + line)
    return found + (["in the log: " + "\n".join(trace)] if trace else [])

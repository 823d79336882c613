"""Under the checks' dots: what is left to do."""


def pytest_terminal_summary(terminalreporter):
    """A line a skipped check: its reason is the next thing to do."""
    for report in terminalreporter.stats.get("skipped", []):
        terminalreporter.write_line(report.longrepr[2].replace("Skipped", "to do", 1))

"""The bytes of metrics.json, pinned: a bit that changes, on any processor or numpy, is seen.

They are our own earlier results, and no proof that they are right: the one exception among the
tests.  python -m tests.test_bytes  pins them again.
"""

import hashlib
import json
import tempfile
from pathlib import Path

import pytest

import constraints as c

PINNED = Path(__file__).with_name("pinned.json")
RUNS = (
    "--smoke",
    "--system triple",
    "--system jansen_leg --integrator rk4 --steps 400",
    "--system windows --integrator gauss --stabilization project --dt 0.02 --steps 200",
    "--system chain --stabilization impulse --steps 1000",
    "--system tight_cable --steps 400",
    "--stabilization baumgarte --steps 30000",
)


def digest(run):
    """The sha256 of the metrics.json of a run."""
    with tempfile.TemporaryDirectory() as folder:
        c.main([*run.split(), "--no-rerun", "--no-page", "--out", folder])
        return hashlib.sha256(Path(folder, "metrics.json").read_bytes()).hexdigest()


@pytest.mark.parametrize("run", RUNS)
def test_the_bytes_of_a_run_are_those_that_are_pinned(run):
    assert digest(run) == json.loads(PINNED.read_text(encoding="utf-8"))[run]


if __name__ == "__main__":
    PINNED.write_text(json.dumps({run: digest(run) for run in RUNS}, indent=2) + "\n", "utf-8")

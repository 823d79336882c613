"""Machine code has the bits of the same lines on Python's floats, one member or eight at a time."""

from curriculum.common import native, trace

import numpy as np
import pytest
from test_trace import CROWD, EXAMPLES, INLINED, by_python, heron, program_of

pytestmark = pytest.mark.skipif(not native.available(), reason="needs the extra fast")


def states(machine, crowd, count, *knobs):
    """The states (count, members, 2, 3) that machine code makes of a crowd, each end checked."""
    state, begin = (crowd.reshape(-1, 6).T.copy() for _ in range(2))
    out = np.empty((count, *state.shape))
    assert machine(state, count, out, *knobs) == count and np.array_equal(state, out[-1])
    assert machine(begin, count, None, *knobs) == count and np.array_equal(begin, out[-1])
    return out.transpose(0, 2, 1).reshape(count, -1, 2, 3)


@pytest.mark.parametrize(("name", "inline"), INLINED)
def test_machine_code_has_the_bits_of_python(name, inline, monkeypatch):
    """Also of a number of members that does not fill the lanes."""
    monkeypatch.setattr(trace, "INLINE", inline)
    program = program_of(EXAMPLES[name])
    alone, lanes = native.Native(program, 1, 1), native.Native(program, native.LANES, 0)
    together = states(lanes, CROWD, 2)
    for k, x in enumerate(CROWD):
        exact = by_python(program, x, 2)
        assert np.array_equal(states(alone, x, 2)[:, 0], exact)
        assert np.array_equal(together[:, k], exact)


def test_a_knob_is_the_same_for_all_lanes():
    program = program_of(lambda x, h, k: x * (h / (1.0 + h * h)) - k * x, "h", "k")
    for lanes in (1, native.LANES):
        found = states(native.Native(program, lanes, 0), CROWD[:lanes], 3, 0.1, 0.7)
        assert np.array_equal(found[:, 0], by_python(program, CROWD[0], 3, 0.1, 0.7))


TROUBLES = {  # at what Python raises an error: a function, and where its third turn goes wrong
    "a divisor of zero": (lambda x: x - 1.0 + 0.0 / (x * x), 2.0),
    "a loop that does not settle in a routine": (lambda x: ROUTINE(x) + 1e100 * x, 1e10),
    "an exponential": (lambda x: np.exp(x), 1.7),
    "a root of less than nothing": (lambda x: np.sqrt(x) - 2.0, 17.0),
    "a power": (lambda x: x**9.0, 20.0),
}
ROUTINE = trace.Routine(heron)


@pytest.mark.parametrize("what", TROUBLES)
def test_a_member_alone_ends_before_a_step_that_python_would_not_do(what, monkeypatch):
    """And one of many lanes ends in what is not finite, while its neighbours go on."""
    monkeypatch.setattr(trace, "INLINE", 0)
    function, start = TROUBLES[what]
    program, x = program_of(function), np.full((6, 1), start)
    out, good = np.empty((9, 6, 1)), [x]
    with pytest.raises((ArithmeticError, ValueError)):
        for _ in out:
            good.append(by_python(program, good[-1], 1).reshape(6, 1))
    crowd = np.hstack([good[-1], *[x] * 7])
    assert native.Native(program, 1, 0)(x, 9, out) == len(good) - 1 > 0
    assert np.array_equal(out[: len(good) - 1], good[1:]) and not np.isfinite(x).all()
    native.Native(program, 8, 0)(crowd, 1, None)
    assert not np.isfinite(crowd[:, 0]).any()
    assert np.array_equal(crowd[:, 1:], np.tile(good[1], 7))

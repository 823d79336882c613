"""What is traced computes what the function computes, to the last bit; or tracing refuses."""

import contextlib
import gc
from functools import partial
from itertools import product

from curriculum.common import arrays, crowds, llvm, native, programs, trace
from curriculum.common.arrays import ordered
from curriculum.common.bytecode import Bytecode
from curriculum.common.crowds import Crowd, OneByOne, mapped
from curriculum.common.native import Native
from curriculum.common.programs import Program, Routine, side_by_side
from curriculum.common.python import Columns, source_of
from curriculum.common.tape import Stop, Untraceable
from curriculum.common.trace import Symbol
from curriculum.common.traced import Single

import numpy as np
import pytest
from test_steps import Machine, Python, Rows, halving

loop = partial(programs.repeat, most=90, complaint="no end")


def fixed_point(following, x, close):
    """x, following(x), ... until the squares of what changes are `close`."""

    def body(y):
        after = following(y)
        return after, np.sum((after - y) * (after - y)) / close

    return loop(body, x)


def heron(x):
    """Square roots by Heron's rule: a loop that knows nothing of rods."""
    return fixed_point(lambda y: 0.5 * (y + x / y), 1.0 + 0.0 * x, 1e-20)


def tangle(seed, x):
    """Any lines at all: sums, products and quotients of what came before, of either sign."""
    rng, pool = np.random.default_rng(seed), [*x.flat]
    for _ in range(60):
        a, b = (pool[k] for k in rng.integers(max(0, len(pool) - 9), len(pool), 2))
        new = (a + b, a - b, 0.5 * a * b, a / (1.5 + b * b))[rng.integers(4)]
        pool.append(-new / (1.0 + new * new) if rng.random() < 0.5 else new * 0.5)
    return np.array(pool[-6:], dtype=x.dtype).reshape(2, 3)


INNER = Routine(lambda a, b: a / (1.0 + b * b) - 0.3 * b)
OUTER = Routine(lambda a, b: INNER(b, -a) + heron(a * a + 0.5) * INNER(a, b))
ROUTINE = Routine(heron)
OFTEN = Routine(lambda a: a / (1.0 + a[::-1] * a[0]), often=True)
ONCE = Routine(lambda a, b: np.stack([a[0] / (1.0 + b[1] * b[1]), -b[0]]), often=True)
ENDING = Routine(lambda a, b: -ONCE(b, -a), often=True)  # with what another makes, called here only
KEPT = np.array([[0.0, 1.0, 0.0], [2.0, 0.0, 3.0]])


def rows(x):
    """Rows of rows; some are zero in the same places, and each has a loop of its own length."""
    many = np.stack([x[0], x[1], KEPT[0] * x[1], KEPT[0] * x[0], -x[1], 0.0 * x[0], x[0] * x[1]])

    def of(a, k):
        inner = side_by_side(lambda b: b / k - x[1], np.stack([a * a, a + 1.0]))
        return heron((a * a + k)[None])[0] - INNER(a, x[0]), inner * a

    ends, pairs = side_by_side(of, many, np.arange(1.0, 8.0) - 0.5)
    return ends[1:3] + ends[4] * ends[5:] - pairs[0] * pairs[3] + pairs[-1]


def handed_on(x):
    """Rows that call a routine, and do little or nothing more."""
    ways = OFTEN, lambda a: -OFTEN(a), lambda a: OFTEN(-a), lambda a: OFTEN(a[[1, 0, 2]])
    made = sum(k * side_by_side(way, x) for k, way in enumerate(ways, 1))
    made -= side_by_side(lambda a: OFTEN(a)[:, None], x)[:, :, 0]
    return made + side_by_side(lambda a: side_by_side(lambda b: b * a[1], np.stack([a, a]))[0], x)


def rounds(x):
    """Rows of a loop that swap places, and one that stands by itself."""
    order = [2, 0, 1]

    def body(y):
        after = side_by_side(lambda a, b: 0.2 * INNER(a, b) + 0.01 * (y[1, 0] * b), y[:3], y[order])
        after = np.concatenate([after[order], -0.5 * y[3:]])
        return after, np.sum((after - y) * (after - y)) / 1e-12

    return loop(body, np.concatenate([x.T, x.T[:1]]))[1:].T


EXAMPLES = {  # x (2, 3) -> (2, 3)
    "matrix": lambda x: (x @ x.T @ np.array([[0.0, 1.0], [2.0, 3.0]]) @ x - x.sum(axis=0)) / 7.0,
    "functions": lambda x: np.sin(x) * np.exp(-x) + np.sqrt(abs(x)) - np.tanh(-x) - np.log(abs(x)),
    "powers": lambda x: (abs(x) ** 1.5) ** 0.2 + 2.0 ** (x**2.0) / 9.0 + (-x) ** 3.0 - -(x**2.0),
    "differences": lambda x: 2.0 / (x[::-1] * x[::-1] + 1.0) - (x - x[::-1]) - (1.0 - (2.0 - x)),
    "both signs": lambda x: np.stack([-(x[0] * x[1]), +(x[0] * x[1])]),
    "infinite": lambda x: 1.0 + x / np.inf + 1e-5 * x,
    "comparisons": lambda x: np.where(x < x[::-1], x * x, 1.0 - x) + 2.0 * (x[0] <= 0.7),
    "limits": lambda x: np.maximum(x, 0.3) - np.minimum(0.5, x[::-1]) * x.max() + x.min(axis=1)[0],
    "one-sided": lambda x: x + np.maximum(0.0, 0.5 - x[0, 0]) + np.clip(x, -0.5, 1.0),
    "norms": lambda x: x * np.linalg.norm(x[0] - x[1]) + np.dot(x, x[0])[:, None] + x.mean(),
    "nested": lambda x: fixed_point(lambda y: 0.5 * (heron(0.5 * y + x * x) + y), x * x, 1e-9),
    "traded": lambda x: x[::-1],
    "handed down": lambda x: np.stack([0.5 * x[1], x[0]]),
    "swapped": lambda x: loop(  # members trade places and signs; the size is minus something
        lambda y: (np.stack([-0.5 * y[1], -y[0]]), -(5.0 - np.sum(abs(y)))), 9.0 * x
    ),
    "widened": lambda x: loop(  # what begins as zero does not stay zero: one row, then another
        lambda y: (np.stack([0.5 * y[0], y[0] + y[2], 0.25 * y[0]]), 1e3 * np.sum(y[0] * y[0])),
        np.stack([x[0], 0.0 * x[0], 0.0 * x[1]]),
    )[1:],
    "routines": lambda x: OUTER(KEPT * x, -x) + OUTER(x, x[::-1]) - OUTER(-x, x + 1.0),
    "rows": rows,
    "rows that call": handed_on,
    "rows in a loop": rounds,
    "loops of routines": lambda x: fixed_point(lambda y: 0.2 * INNER(y, x) + 0.1 * x, x, 1e-12),
}
EXAMPLES["routines that end with another"] = lambda x: ENDING(x, x) + ENDING(-x, ENDING(x[::-1], x))
EXAMPLES["counts"] = lambda x: x + np.sum((x > 0.5) * 1.0) - (x[0, 0] < x[1, 1]) * (x[0] <= 1.0)
EXAMPLES["tangle"] = partial(tangle, 0)
INLINED = [(name, programs.INLINE) for name in EXAMPLES]
INLINED += [(name, 0) for name in ("routines", "rows", "loops of routines")]
CROWD = np.random.default_rng(5).uniform(0.1, 2.0, (19, 2, 3)) * [[1.0, -1.0, 1.0], [1.0] * 3]
CROWD[3] *= 1e-3  # it takes its loops more turns than the others


def program_of(function, *knobs):
    return Program(lambda x, *k: (function(x, *k),), np.zeros((2, 3), dtype=bool), knobs=knobs)


def step_of(function):
    return lambda q, v, *_: (function(q), v)


def paths(way, function, *starts, count=2):
    """Where a function leads from starts (2, 3), turn by turn, as far as it goes."""
    stepper, found = way(step_of(function), None, None, 0.0, lambda q, v: (v[0, 0],)), []
    for q in starts:
        stepper.start(0.0, count)
        v, path = 0.0 * q, []
        with np.errstate(all="ignore"), contextlib.suppress(Stop):
            while len(path) < count and np.isfinite(q).all():
                q, v = next(iter(stepper.ahead(q, v)))
                path.append(q)
        assert stepper.single, stepper.how  # else the lines as they stand have mended it
        found.append(path)
    return found


def in_every_code(function, members, count=1, measure=None):
    """What members (R, 2, 3) that go together are run by, their ends, and the largest that was
    measured."""
    crowd = Crowd(step_of(function), None, None, 0.0, members, 0.0 * members, measure)
    traced = crowd.traced
    kernels = [crowd.kernel, OneByOne(traced)]
    kernels += [Bytecode(traced.program, 8)] if llvm.available() else []
    kernels += [] if traced.program.loops() else [Columns(traced.source)]
    for kernel in kernels:
        crowd.kernel = kernel
        crowd.put(members, 0.0 * members)
        largest = crowd.advance(count)
        yield kernel, crowd.states()[0], largest


@pytest.mark.parametrize(("name", "inline"), INLINED)
def test_any_function_of_small_arrays_is_compiled_exactly(name, inline, monkeypatch):
    """As Python, machine code or bytecode, for one member or for lanes, not all full; without
    these members go as columns or one by one. Each ends its loops where it would alone. All
    have the bits of the lines as they stand."""
    function = EXAMPLES[name]
    loose = 1e-12 if name in ("functions", "powers") else 0.0  # the last bit is numpy's own
    near = partial(np.allclose, rtol=loose, atol=loose)
    monkeypatch.setattr(programs, "INLINE", inline)
    python = paths(Python, function, *CROWD)
    for way in (Machine, Rows):
        assert np.array_equal(paths(way, function, *CROWD[:4]), python[:4])
    first = [path[0] for path in python]
    assert near(first, [function(ordered(x)) for x in CROWD])
    assert np.allclose(first, [function(x) for x in CROWD])  # numpy's own sums, but for order
    monkeypatch.delattr(Single, "one")  # no member has trouble, which another way would mend
    for code, q, _ in in_every_code(function, CROWD):
        assert near(q, first) if isinstance(code, Columns) else np.array_equal(q, first)
    assert near(mapped(lambda q, v: function(q))(CROWD, 0.0 * CROWD), first)


ROW = ordered([0.25, -2.0, 0.0])
ASKED = {  # what numpy's functions are asked for besides: of numbers, and of symbols
    "initial": lambda x: np.max(np.abs(x), initial=0.5),
    "keepdims": lambda x: np.sum(x, keepdims=True) * np.max(x, axis=0, keepdims=True),
    "places": lambda x: x[np.where(np.asarray([0, 1, 1]))[0][0] - 1],
    "bounds": lambda x: np.clip(x, a_min=-1.0, a_max=0.1),
    "of a number": lambda x: np.dot(2.0, x),
    "a divisor of zero": lambda x: 1.0 / np.sum(0.0 * x[:, None], axis=0)[0] > 5.0,
    "nothing by nothing": lambda x: np.zeros(12) / np.repeat(x, 4) > -1.0,
    "where": lambda x: np.divide(
        np.repeat(x, 4), 8.0, out=np.zeros_like(x, shape=12), where=np.repeat(x, 4) < 0.1
    ),
    "zero by what is known to be zero": lambda x: np.nan_to_num(x / (x < -1.0), posinf=5.0),
    "no entries": lambda x: np.sum(x[:0].reshape(0, 2), axis=0),
    "no columns": lambda x: np.mean(x[:, None][:, :0], axis=0),
    "another norm": lambda x: np.linalg.norm(x.reshape(1, 3), 1) + np.linalg.norm(x[None], 2),
    "new names": lambda x: np.clip(x, min=-1.0),
    "a count": lambda x: np.array([0.0, 1.5, 3.5, 7.5])[np.sum(x > -1.0)],
    "true or true": lambda x: (x > -1.0) + (x < 1.0),
    "true and true": lambda x: (x > -1.0) * (x < 1.0) + (x > 0.0),
    "true at true": lambda x: (x > -1.0) @ (x < 1.0) + 2.0 * np.dot((x > -3.0)[None], x < 1.0),
    "true by a number": lambda x: np.where(np.maximum(0.0 * x, 0.5) < 1.0, x, -x),
    "counts of what is known": lambda x: np.sum(0.0 * x <= np.zeros(3)),
    "a mean of some": lambda x: np.mean(x, where=np.asarray([True, False, True])),
    "a mean elsewhere": lambda x: np.mean(x[None], axis=0, out=np.zeros_like(x)),
    "what is imaginary": lambda x: np.sum(1j * x[None], axis=0).imag + np.linalg.norm(1j * x),
}


@pytest.mark.parametrize("name", ASKED)
def test_what_is_asked_of_a_function_besides_is_never_left_out(name):
    """Many states at once have what each has alone, and that is what numpy itself makes."""
    function, many = ASKED[name], np.stack([ROW, -ROW, 0.1 * ROW])[:, None]
    with np.errstate(all="ignore"):
        alone = [np.asarray(function(ordered(q[0]))) for q in many]
        assert np.array_equal(alone, [function(np.asarray(q[0])) for q in many])
        found = mapped(lambda q, v: function(q[0]) * 1.0, uses=10**6)(many, 0.0 * many)
    assert np.array_equal(found, alone)


def test_what_numpy_makes_of_ordered_arrays_adds_in_order_too():
    made = np.where(ROW < 0.0, ROW, -ROW), np.cross(ROW, ROW), np.outer(ROW, ROW), np.tril(ROW)
    assert {type(x) for x in made} == {type(ROW)}


def test_a_product_of_many_numbers_that_are_not_zero_is_made_in_parts(monkeypatch):
    """So that its terms do not fill the memory; and what is no float stays what it is."""
    a, b = ordered(np.random.default_rng(3).normal(size=(2, 70, 70)))
    whole = np.arange(4900).reshape(70, 70)
    found = []
    for bound, most in (("SMALL", arrays.SMALL), ("TERMS", 1000), ("SMALL", 10**9)):
        monkeypatch.setattr(arrays, bound, most)
        found.append((a @ b, a.T @ b.T, arrays.product(whole, whole)))
    assert all(map(np.array_equal, found[0] + found[1], 2 * found[2]))
    assert all(made[-1].dtype == int for made in found)


def test_what_was_traced_before_does_not_decide_what_can_be(monkeypatch):
    monkeypatch.setattr(trace, "LONG", 20)
    mapped(lambda q, v: np.sum(q * q))(CROWD[:2], CROWD[:2])
    assert len(program_of(EXAMPLES["tangle"]).tape.nodes) > 20


def test_what_is_soon_done_of_few_states_is_compiled_once_there_are_many():
    asked, many = mapped(lambda q, v: np.sum(q * q)), np.repeat(CROWD, 20, axis=0)
    for states, compiled in ((CROWD[:2], False), (many, True), (CROWD[:2], True)):
        asked(states, states)
        (entry,) = asked.entries.values()
        assert (entry.kernel is not None) == compiled


@pytest.mark.skipif(not llvm.available(), reason="without llvmlite there is no machine code")
@pytest.mark.parametrize(("bound", "kind"), [("LARGE", Bytecode), ("MANY", Native)])
def test_a_function_that_is_long_or_asked_often_becomes_machine_code(bound, kind, monkeypatch):
    """Also without a loop: rows, which are sooner made, or code that is sooner done."""
    monkeypatch.setattr(crowds, bound, 2)
    asked, many = mapped(lambda q, v: np.sum(q / (1.0 + q * q))), np.repeat(CROWD, 20, axis=0)
    found = asked(many, many)
    assert isinstance(next(iter(asked.entries.values())).kernel, kind)
    assert np.array_equal(found, [asked.measure(ordered(q), q)[0] for q in many])


def test_what_a_function_leaves_in_one_array_each_time_is_what_it_was_for_each_state():
    place = np.zeros(3)

    def filling(q):
        place[...] = q[0]
        return place

    assert np.array_equal(mapped(filling)(CROWD, CROWD), CROWD[:, 0])


@pytest.mark.parametrize("count", [1, 2, 19])
def test_a_function_that_works_in_place_leaves_the_many_states_as_they_are(count):
    def doubled(q):
        q *= 2.0
        return q

    many = CROWD[:count].copy()
    assert np.array_equal(mapped(doubled)(many, 0.0 * many), 2.0 * CROWD[:count])
    assert np.array_equal(many, CROWD[:count])


def test_a_mask_is_one_of_many_states_too_and_no_step_changes_none():
    asked, many = mapped(lambda q: (q > 0.0, q)), np.repeat(CROWD, 20, axis=0)
    for states in (CROWD[:2], many):
        assert [x.dtype for x in asked(states, states)] == [bool, float]
    crowd = Crowd(step_of(np.exp), None, None, 0.0, CROWD, 0.0 * CROWD)
    crowd.advance(0)
    assert np.array_equal(crowd.states()[0], CROWD)


def test_of_many_states_the_one_with_the_most_zeros_is_compared_too():
    """Since a symbol does not keep the sign of a zero, and the angle of a level rod needs it."""
    level = CROWD.copy()
    level[4, 0] = -1.0, 0.0, 0.5
    asked = mapped(lambda q: np.arctan2(-q[:, 1], q[:, 0]), uses=10**6)
    angles = asked(level, 0.0 * level)
    assert np.array_equal(angles, [asked.measure(ordered(q), q)[0] for q in level])
    assert angles[4, 0] == -np.pi


@pytest.mark.parametrize("most", [2**60, -(2**60)])
def test_a_large_whole_number_of_many_states_is_not_rounded(most):
    asked = mapped(lambda q: most + np.sum(q > 0.5), uses=10**6)
    assert asked(CROWD, CROWD).tolist() == [most + np.sum(q > 0.5).item() for q in CROWD]


TROUBLES = {  # at what Python raises an error: a function, and where its third turn goes wrong
    "a divisor of zero": (lambda x: x - 1.0 + 0.0 / (x * x), 2.0),
    "a loop that does not settle in a routine": (lambda x: ROUTINE(x) + 1e100 * x, 1e10),
    "loops of rows that do not settle": (
        lambda x: side_by_side(lambda a, k: heron(k * a[None])[0] + 1e100 * a, x, np.array([1, 2])),
        1e10,
    ),
    "a loop that wants one turn more": (
        lambda x: 3.0 * x + 1e-9 * programs.repeat(lambda y: (0.5 * y, y[0, 0]), x, 5, "no end"),
        2.0,
    ),
    "an exponential": (np.exp, 1.7),
    "a root of less than nothing": (lambda x: np.sqrt(x) - 2.0, 17.0),
    "a power": (lambda x: x**9.0, 20.0),
}


@pytest.mark.parametrize(("function", "start"), TROUBLES.values(), ids=TROUBLES)
def test_machine_code_ends_where_python_would_raise_an_error(function, start, monkeypatch):
    """And one of many lanes ends in what is not finite, while its neighbours go on."""
    monkeypatch.setattr(programs, "INLINE", 0)
    x = np.full((2, 3), start)
    ways = Python, Machine, Rows
    (path,), *others = (paths(way, function, x, count=9) for way in ways)
    assert 1 <= len(path) < 9
    assert all(np.array_equal(other, [path], equal_nan=True) for other in others)
    last = [q for q in path if np.isfinite(q).all()][-1]
    for code, q, _ in in_every_code(function, np.stack([*[x] * 7, last])):
        assert np.array_equal(q[:7], [path[0]] * 7) or isinstance(code, Columns)
        assert not np.isfinite(q[7]).any()


@pytest.mark.parametrize("use", [lambda last: last * last, lambda last: last])
def test_a_number_from_an_earlier_call_is_refused_though_it_meets_only_itself(use):
    """Or is only returned."""
    with pytest.raises(Untraceable, match="it keeps a number from an earlier call"):
        program_of(lambda x: use(halving(x)[1][-1]))


def test_a_loop_without_an_end_in_one_of_many_states_is_told():
    many = abs(CROWD)
    many[7] = -0.7  # which has no root
    with pytest.raises(Stop, match="no end"):
        mapped(heron, uses=10**6)(many, many)


@pytest.mark.skipif(not llvm.available(), reason="without llvmlite there is no machine code")
def test_a_step_is_not_counted_if_any_one_number_of_its_end_is_not_finite():
    program = program_of(lambda x: 1e3 * x)
    for code, k in product((Native, Bytecode), range(6)):
        state = np.where(np.arange(6) == k, 1e300, 1.0)[:, None]
        assert code(program)(state, 9, np.empty((9, 6)))[0] == 2


def test_a_trace_leaves_it_as_it_was_whether_garbage_is_looked_for():
    for switch, on in ((gc.disable, False), (gc.enable, True)):
        switch()
        Crowd(step_of(np.exp), None, None, 0.0, CROWD, 0.0 * CROWD)
        assert gc.isenabled() == on


def test_what_is_not_needed_is_not_done_nor_kept():
    """Products with zero, with one, repeated ones and those that nobody asks for vanish, and the
    calls of a short routine. What is the same in all turns is done once, before them."""
    program = program_of(lambda x: x * KEPT * 1.0 + 0.0 * (x / 3.0))
    assert len(program.tape.needed(program.out)) == 2  # of 6: two products
    twice = program_of(lambda x: np.stack([x[0, 0] * 2.5 + 1.0, 1.0 + 2.5 * x[0, 0]]))
    assert [sign for sign, *_ in twice.tape.nodes.values()] == ["*", "+"]
    assert not program_of(lambda x: INNER(x, x)).tape.parts
    program = program_of(lambda x: OFTEN(x) + OFTEN(2.0 * x))
    assert len(program.tapes()) == 2  # the routine counts once
    program = program_of(lambda x: side_by_side(OFTEN, x))
    assert len(program.tapes()) == 2  # and rows that only call it are its calls
    program = program_of(lambda x, h: x + (h * h / 3.0) / (1.0 + x * x) + h / 2.0, "h")
    assert "h" not in source_of(program).split("for _ in range(count):")[1].split()
    constants = program_of(lambda x: x * np.exp(ordered(KEPT - 0.5) / 3.0) ** 2.0)
    assert [sign for sign, *_ in constants.tape.nodes.values()] == ["*"] * 6


def test_zeros_by_what_may_be_zero_are_divided():
    """Since 0 / 0 is no number."""
    program = program_of(lambda x: (np.zeros((2, 3, 2)) / x[:, :, None])[:, :, 0])
    assert [sign for sign, *_ in program.tape.nodes.values()] == ["/"] * 6
    with pytest.raises(ZeroDivisionError):  # which refuses it
        program_of(lambda x: np.repeat(x * KEPT, 2) / np.repeat(KEPT, 2))


def test_who_prints_a_symbol_is_told_of_plain_once(monkeypatch, capsys):
    monkeypatch.setattr(Symbol, "told", False)
    program_of(lambda x: print(x[0, 0], -x[1, 2]) or x)
    seen = capsys.readouterr()
    assert seen.out == "x_0_0 -x_1_2\n" and seen.err.count("--plain") == 1


def test_a_crowd_keeps_the_largest_of_what_is_measured():
    """At any of its steps, whatever runs it; of members whose last step is not their largest."""
    steps = [CROWD * (-0.9) ** k for k in (1, 2, 3)]
    most = np.max([[*q[:, 0].T, q.sum(axis=(1, 2))] for q in steps], axis=0)
    shrinking = in_every_code(lambda x: -0.9 * x, CROWD, 3, lambda q, v: (q[0], np.sum(q)))
    for _, _, largest in shrinking:
        assert np.allclose(largest, most, rtol=1e-12, atol=0.0)


@pytest.mark.skipif(not llvm.available(), reason="without llvmlite there is no machine code")
@pytest.mark.parametrize("turns", [1, 2, native.TURNS])
def test_each_of_many_members_takes_its_step_however_many_go_in_one_call(turns, monkeypatch):
    monkeypatch.setattr(native, "TURNS", turns)
    monkeypatch.setattr(crowds, "CORES", 1)
    many = np.concatenate([k * CROWD for k in range(1, 6)])
    crowd = Crowd(step_of(lambda x: -x), None, None, 0.0, many, many, lambda q, v: (q[0, 0],))
    assert np.array_equal(crowd.advance(1), -many[:, 0, :1].T)
    assert np.array_equal(crowd.states()[0], -many)


def test_a_product_of_many_terms_has_the_bits_of_one_of_few(monkeypatch):
    a, b = np.random.default_rng(7).normal(size=(2, 30, 30)) * (CROWD.flat[:30] > 1.0)
    pairs = [(x, y) for x in (a, a.T) for y in (b, b.T, 0.0 * b)]
    few = [ordered(x) @ y for x, y in pairs]
    monkeypatch.setattr(arrays, "SMALL", 0)
    assert all(np.array_equal(ordered(x) @ y, z) for (x, y), z in zip(pairs, few, strict=True))

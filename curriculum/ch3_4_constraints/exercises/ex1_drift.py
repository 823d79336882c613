"""Exercise 1: predict, then run. What becomes of a rod whose error nobody takes back?

    python -m curriculum.ch3_4_constraints.exercises.ex1_drift

All runs here are of the naive solve: gddot = 0, and nothing else.
"""

import json
from pathlib import Path

import constraints as c
from curriculum.ch3_4_constraints.exercises import Wrong, blank, run

NOTE = (
    c.HERE / f"outputs/prediction_{Path(__file__).parent.name}.json"
)  # yours, as it was before the first run
CHOICES = {"rod": ["stays", "grows", "oscillates"], "heavy": ["smaller", "the same", "larger"]}


# Fill in predict() first, then run this file. A wrong guess costs nothing; a guess made after the
# run counts nothing.
def predict():
    """What you expect, before you have seen it."""
    return {
        # A pendulum, released level, 20 s by semi_implicit: what does the error of its rod do in
        # time?
        "rod": blank("write down a guess: 'stays', 'grows' or 'oscillates'"),
        # The double pendulum, 10 s by rk4: dt 0.01, then dt 0.005. The worst rod error is divided
        # by?
        "factor": blank(
            "write down a guess: by how much does half the step divide rk4's worst rod error?"
        ),
        # The first pendulum again, its bob ten times as heavy. Its rod error becomes?
        "heavy": blank("write down a guess: 'smaller', 'the same' or 'larger'"),
    }


# Then say what you have seen, in the same words,
def found():
    """What the runs showed."""
    return {
        "rod": blank("say what the run showed: 'stays', 'grows' or 'oscillates'"),
        "factor": blank("say what the runs showed: the factor"),
        "heavy": blank("say what the runs showed: 'smaller', 'the same' or 'larger'"),
    }


# and why. The rod is 1 m long, the bob starts at rest, and semi_implicit moves it by dt v along the
# tangent.
def expected_g(speeds, dt):
    """g in m^2 of the pendulum after the last step, from the speeds |v| (steps,) in m/s after each
    step: one line."""
    return blank(
        "g after the run from the speeds; draw one step, tangent and circle: how far outside does it end?"
    )


def naive(system, rule, dt, steps):
    """A Run that asks for gddot = 0 only, all its states kept."""
    return c.simulate(
        c.INTEGRATORS[rule], system, c.make_force(system, 0.0), dt, steps, range(steps + 1)
    )


def write_down(prediction):
    """The prediction as it was before the first run: written to NOTE once, and never over an older
    one."""
    for key, allowed in CHOICES.items():
        if prediction[key] not in allowed:
            raise Wrong(
                f"{key!r} is {prediction[key]!r}; choose one of {', '.join(map(repr, allowed))}"
            )
    if not NOTE.exists():
        NOTE.parent.mkdir(exist_ok=True)
        NOTE.write_text(json.dumps(prediction, indent=2) + "\n", encoding="utf-8")
    return json.loads(NOTE.read_text(encoding="utf-8"))


def main():
    """Write the prediction down, then show what it was about."""
    print(f"you wrote down {write_down(predict())}\n")
    pendulum, heavy, double = (c.build_system(name) for name in ("pendulum", "pendulum", "double"))
    heavy["m"] = 10.0 * heavy["m"]
    runs = [naive(system, "semi_implicit", 0.005, 4000) for system in (pendulum, heavy)]
    print("semi_implicit, dt 0.005, rod error in m\n   after   bob of 1 kg  bob of 10 kg")
    for seconds in (1, 2, 5, 10, 15, 20):
        print(f"{seconds:6d} s" + "".join(f"{run.violations[200 * seconds]:14.6f}" for run in runs))
    print("\nrk4, the double pendulum over 10 s, worst rod error in m")
    for dt in (0.01, 0.005):
        print(f"dt {dt:<5g} {naive(double, 'rk4', dt, round(10 / dt)).violations.max():12.3e}")
    speeds = c.dot(runs[0].v, runs[0].v)[1:, 0] ** 0.5
    g = c.constraint_terms(pendulum, runs[0].q[-1], runs[0].v[-1])[1][0]
    print(
        f"\ng of the first run after 20 s, in m^2: {g:.9f}; by your line: {expected_g(speeds, 0.005):.9f}"
    )


if __name__ == "__main__":
    run(main)

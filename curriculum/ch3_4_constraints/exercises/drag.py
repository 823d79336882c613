"""Exercise 4: air drag on every particle. The rods answer to it although nothing told them."""

import constraints

DRAG = 0.2  # N s/m


def weight_and_drag(system, q, v):
    """Newtons (..., N, 3): the weight, and a drag proportional to the velocity."""
    return system["weight"] - DRAG * v


def main():
    """Rod error and energy change of the double pendulum after 20 s, without and with drag."""
    system = constraints.build_system("double")
    hold = constraints.hold_table()["project"]
    weight_alone = constraints.external_force
    try:
        for name, force in (("weight", weight_alone), ("weight and drag", weight_and_drag)):
            constraints.external_force = force
            run = constraints.simulate(system, "rk4", hold, keep=[4000])
            energy = float(run["kept"]["energy"][0])
            print(f"{name:<16} rod error {float(run['max_violation']):.0e} m, energy {energy:+.3f} m g L after 20 s")
    finally:
        constraints.external_force = weight_alone


if __name__ == "__main__":
    main()

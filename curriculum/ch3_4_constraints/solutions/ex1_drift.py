def guess():
    return {"rod": "shrinks", "factor": 16}


def expected_g(speeds, dt):
    return 0.5 * dt**2 * (speeds**2).sum()

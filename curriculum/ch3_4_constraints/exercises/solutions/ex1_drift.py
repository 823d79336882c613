def answer():
    return {"rod": "grows", "factor": 16, "heavy": "the same"}


def why():
    return "Each step leaves along the tangent, which lies outside the circle, and none leads back."


def expected_g(speeds, dt):
    return 0.5 * dt**2 * (speeds**2).sum()

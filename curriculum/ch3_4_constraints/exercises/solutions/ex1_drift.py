def predict():
    return {"rod": "grows", "factor": 16, "heavy": "the same"}


def found():
    why = "Every step leaves along the tangent, which lies outside the circle, and none leads back."
    return {"rod": "grows", "factor": 15.9, "heavy": "the same", "why": why}


def expected_g(speeds, dt):
    return 0.5 * dt**2 * (speeds**2).sum()

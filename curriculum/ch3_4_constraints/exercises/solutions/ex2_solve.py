def turning(d, rate):
    return rate @ rate


def mobility(jac, inverse_m):
    return (jac * inverse_m) @ jac.T


def wanted(g, gdot, w):
    return -2.0 * w * gdot - w**2 * g

def jdotv(d, d_dot):
    return d_dot @ d_dot


def target(g, gdot, w):
    return -2.0 * w * gdot - w**2 * g

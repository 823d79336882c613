def guess():
    return {1e-12: 34.4, 1e-24: 60.0}

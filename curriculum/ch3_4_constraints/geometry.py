"""Where rods are, and what room they need: for the moving picture and the recording."""

from curriculum.ch3_4_constraints.statics import nodes

import numpy as np


def rod_ends(system, q):
    """Tails, marks and heads of rods, (F, C, 3) each, in m, at positions q (F, N, 3); and |d| - L
    (F, C), above 0 where a rod is too long.

    A rod's tail is at its partner, its head at its particle, and its mark where it would end if it
    had its length: before the head of a rod that is too long, beyond that of one too short.
    """
    ends = nodes(q, system["anchors"])[:, system["pairs"]]
    heads, tails = np.moveaxis(ends, 2, 0)
    lengths = system["lengths"]
    size = np.linalg.norm(heads - tails, axis=-1)
    share = lengths / np.maximum(size, 1e-9 * lengths)  # a rod of no length has no direction
    return tails, tails + share[..., None] * (heads - tails), heads, size - lengths


def box(system, runs):
    """Two corners (3,) around the modes whose rods keep to half their length, or else around the
    best; and a length to compare with: 1 m, or another power of ten that fits."""
    worst = {m: np.inf if run.stopped else np.max(run.violations) for m, run in runs.items()}
    good = [mode for mode in runs if worst[mode] < 0.5 * np.max(system["lengths"])]
    good = good or [min(worst, key=worst.get)]
    shown = np.concatenate([nodes(runs[mode].q, system["anchors"]) for mode in good])
    # one axis after the other, which is far quicker
    low, high = (edge(edge(shown, axis=0), axis=0) for edge in (np.min, np.max))
    size = np.max(high - low)
    return low - 0.06 * size, high + 0.06 * size, 10.0 ** np.floor(np.log10(size))


def tiling(count, shape, size, words, least=0):
    """How many of `count` tiles go side by side to show a `size` (x, y) largest; x and y of each.

    In pixels: the sheet's `shape` (x, y), the room of a tile's `words`, and its `least` width.
    """
    layouts = [(k, shape[0] / k, shape[1] / -(-count // k) - words) for k in range(1, count + 1)]
    layouts = [layout for layout in layouts if layout[1] >= least]
    return max(layouts, key=lambda layout: min(layout[1] / size[0], layout[2] / size[1]))

"""Pareto-smoothed weights and their shape, by ArviZ, for loo.tsv.

k n        the weights before: u^-k at u = (i + 0.5)/n, i = 0 ... n - 1
shape      the shape of the largest that ArviZ finds
largestR   the R-th largest weight after smoothing, where all sum to one
"""

import os

import arviz
import numpy as np

here = os.path.dirname(os.path.abspath(__file__))
with open(os.path.join(here, "loo.tsv"), "w") as table:
    table.write("k\tn\tshape\tlargest1\tlargest2\tlargest10\n")
    for k in (0.1, 0.4, 0.7, 1.2):
        for n in (100, 1000):
            ln = -k * np.log((np.arange(n) + 0.5) / n)
            smooth, shape = arviz.psislw(ln)
            w = np.sort(np.exp(smooth - np.logaddexp.reduce(smooth)))[::-1]
            table.write("\t".join(repr(float(x)) for x in (k, n, shape, w[0], w[1], w[9])) + "\n")

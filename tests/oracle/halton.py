"""Halton and Sobol' points, unscrambled (scipy.stats.qmc); d columns of the table are the d-dimensional sequence."""

from scipy.stats import qmc
from tables import write_table

D = 8


def points(sampler, first, n):
    if first:
        sampler.fast_forward(first)
    return [[first + i, *x] for i, x in enumerate(sampler.random(n))]


header = ["index"] + [f"x{j}" for j in range(1, D + 1)]
halton = points(qmc.Halton(D, scramble=False), 0, 64)
sobol = points(qmc.Sobol(D, scramble=False), 0, 64)
for d in range(1, D):
    for table, kind in ((halton, qmc.Halton), (sobol, qmc.Sobol)):
        low = kind(d, scramble=False).random(64)
        assert all(list(x) == row[1 : d + 1] for x, row in zip(low, table))
write_table("halton.tsv", header, halton)
write_table("sobol.tsv", header, sobol)
write_table("halton_100000.tsv", header, points(qmc.Halton(D, scramble=False), 100_000, 8))

"""Posteriors of curved problems with known noise: two parameters on a grid, four by emcee.

`two`: y = a (1 - exp(-b x)). `four`: that beside z = c x^d + a b x / 4. Uniform priors in the boxes of the params
tables; independent Gaussian noise of 0.05. `grid` is a quadrature, exact to its digits; `emcee` has 64 walkers of 40 000
steps, so that its means are good to 0.01 standard deviations.
"""

import emcee
import numpy as np
from tables import write_table

NOISE = 0.05
X = np.round(np.arange(1, 21) / 20, 3)
NAMES = ["a", "b", "c", "d"]
BOX = np.array([[0.2, 2.0], [0.2, 6.0], [0.2, 1.8], [0.3, 3.0]])
TRUTH = np.array([0.9, 1.8, 0.8, 1.4])


def y(p):
    return p[..., 0, None] * (1 - np.exp(-p[..., 1, None] * X))


def z(p):
    return p[..., 2, None] * X ** p[..., 3, None] + p[..., 0, None] * p[..., 1, None] * X / 4


rng = np.random.default_rng(11)
seen_y = np.round(y(TRUTH) + NOISE * rng.normal(size=X.size), 4)
seen_z = np.round(z(TRUTH) + NOISE * rng.normal(size=X.size), 4)
rows = []


def add(data, by, name, values, weights):
    order = np.argsort(values)
    values, weights = values[order], weights[order] / weights.sum()
    below = np.cumsum(weights) - 0.5 * weights
    mean = np.sum(weights * values)
    rows.append([data, by, f"mean({name})", mean])
    rows.append([data, by, f"sd({name})", np.sqrt(np.sum(weights * (values - mean) ** 2))])
    for quantile, p in [("q05", 0.05), ("q95", 0.95)]:
        rows.append([data, by, f"{quantile}({name})", np.interp(p, below, values)])


# Midpoints of 1200 cells a side.
cells = (np.arange(1200) + 0.5) / 1200
a, b = (low + (high - low) * cells for low, high in BOX[:2])
square = np.array([np.sum(((seen_y - y(np.stack([np.full_like(b, at), b], 1))) / NOISE) ** 2, 1) for at in a])
weights = np.exp(-0.5 * (square - square.min()))
add("two", "grid", "a", a, weights.sum(1))
add("two", "grid", "b", b, weights.sum(0))


def ln_posterior(p):
    inside = np.all((p >= BOX[:, 0]) & (p <= BOX[:, 1]), axis=1)
    p = np.clip(p, BOX[:, 0], BOX[:, 1])
    misfit = np.sum(((seen_y - y(p)) / NOISE) ** 2, 1) + np.sum(((seen_z - z(p)) / NOISE) ** 2, 1)
    return np.where(inside, -0.5 * misfit, -np.inf)


np.random.seed(5)
sampler = emcee.EnsembleSampler(64, 4, ln_posterior, vectorize=True)
sampler.run_mcmc(TRUTH + 0.01 * rng.normal(size=(64, 4)), 40_000)
chain = sampler.get_chain(discard=2_000, flat=True)
for j, name in enumerate(NAMES):
    add("four", "emcee", name, chain[:, j], np.ones(len(chain)))

write_table("curve_posterior.tsv", ["data", "by", "quantity", "value"], rows)
write_table("curve_posterior_obs.txt", ["x", "y", "z"], zip(X, seen_y, seen_z))
for data, count in [("two", 2), ("four", 4)]:
    bounds = [[name, *box] for name, box in zip(NAMES, BOX.tolist())][:count]
    write_table(f"curve_posterior_{data}_params.txt", ["name", "lower", "upper"], bounds)

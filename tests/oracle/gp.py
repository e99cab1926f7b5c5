"""Gaussian process regression by scikit-learn with fixed hyperparameters: amplitude² × Matérn 5/2 (a length a
parameter) + noise variance on the diagonal, zero mean.

`ln_marginal_likelihood` is of y; `gradient` is with respect to ln amplitude², ln length_1..3, ln noise variance.
`mean`, `sd_latent` (of the function) and `sd` (of a reading: with the noise) are at `at`. Leave-one-out mean and
variance (of a reading) refit on the other rows with the same hyperparameters.
"""

import numpy as np
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel
from tables import write_json

HYPERPARAMETERS = [
    # amplitude², lengths, noise variance
    (1.0, [1.0, 1.0, 1.0], 1e-2),
    (1.3, [0.4, 0.9, 2.5], 1e-3),
    (0.5, [0.15, 0.3, 10.0], 5e-2),
    (4.0, [2.0, 3.0, 50.0], 1e-6),
]


def regressor(amplitude2, lengths, noise):
    kernel = ConstantKernel(amplitude2) * Matern(lengths, nu=2.5) + WhiteKernel(noise)
    return GaussianProcessRegressor(kernel, alpha=0.0, optimizer=None, normalize_y=False)


rng = np.random.default_rng(3)
x = rng.uniform(0, 1, (30, 3)).round(4)
y = (np.sin(4 * x[:, 0]) + x[:, 1] ** 2 - 0.3 * x[:, 2] + rng.normal(0, 0.05, 30)).round(4)
y = (y - y.mean()).round(4)
at = np.vstack([rng.uniform(-0.2, 1.2, (7, 3)).round(3), x[:1]])

fits = []
for amplitude2, lengths, noise in HYPERPARAMETERS:
    gp = regressor(amplitude2, lengths, noise).fit(x, y)
    value, gradient = gp.log_marginal_likelihood(gp.kernel_.theta, eval_gradient=True)
    mean, sd = gp.predict(at, return_std=True)
    left_out = []
    for i in range(len(x)):
        rest = np.arange(len(x)) != i
        m, s = regressor(amplitude2, lengths, noise).fit(x[rest], y[rest]).predict(x[i : i + 1], return_std=True)
        left_out.append((m[0], s[0] ** 2))
    fits.append(
        {
            "amplitude2": amplitude2,
            "lengths": lengths,
            "noise": noise,
            "ln_marginal_likelihood": float(value),
            "gradient": gradient.tolist(),
            "mean": mean.tolist(),
            "sd": sd.tolist(),
            "sd_latent": np.sqrt(sd**2 - noise).tolist(),
            "loo_mean": [float(m) for m, _ in left_out],
            "loo_variance": [float(v) for _, v in left_out],
        }
    )

write_json("gp.json", {"x": x.tolist(), "y": [y.tolist()], "at": at.tolist(), "fits": fits})

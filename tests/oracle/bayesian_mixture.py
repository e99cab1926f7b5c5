"""Variational Bayesian Gaussian mixtures by scikit-learn from given initial responsibilities.

One JSON a data set. `fits` holds every covariance type, both weight priors, and the state after
exactly 1 and 5 iterations (tol = 0) and at convergence (tol = 1e-10). `max_iter` counts as
scikit-learn does: the responsibilities given feed a first maximisation that is not counted, then an
iteration is one expectation and one maximisation. Convergence stops `n_iter` iterations later.
"""

import warnings

import numpy as np
from scipy.special import logsumexp
from scipy.stats import multivariate_normal
from sklearn.exceptions import ConvergenceWarning
from sklearn.mixture import BayesianGaussianMixture
from tables import write_json

COVARIANCE = ["full", "tied", "diag", "spherical"]
CONCENTRATION = ["dirichlet_process", "dirichlet_distribution"]
RUNS = [(1, 0.0), (5, 0.0), (2000, 1e-10)]


class FromResponsibilities(BayesianGaussianMixture):
    def _initialize_parameters(self, X, random_state, xp=None):
        self._initialize(X, np.array(self.given))


def fit(x, resp, covariance_type, prior_type, max_iter, tol):
    model = FromResponsibilities(
        n_components=resp.shape[1],
        covariance_type=covariance_type,
        weight_concentration_prior_type=prior_type,
        max_iter=max_iter,
        tol=tol,
    )
    model.given = resp
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model.fit(x)
    return model


def full_covariances(model, d):
    c, k = model.covariances_, model.n_components
    return {
        "full": lambda: c,
        "tied": lambda: [c] * k,
        "diag": lambda: [np.diag(v) for v in c],
        "spherical": lambda: [v * np.eye(d) for v in c],
    }[model.covariance_type]()


def record(model, at):
    prior = model.covariance_prior_
    dp = model.weight_concentration_prior_type == "dirichlet_process"
    ln_terms = [
        np.log(w) + np.atleast_1d(multivariate_normal.logpdf(at, m, c))
        for w, m, c in zip(model.weights_, model.means_, full_covariances(model, at.shape[1]))
    ]
    return {
        "covariance_type": model.covariance_type,
        "weight_concentration_prior_type": model.weight_concentration_prior_type,
        "max_iter": model.max_iter,
        "tol": model.tol,
        "n_iter": int(model.n_iter_),
        "converged": bool(model.converged_),
        "reg_covar": model.reg_covar,
        "weight_concentration_prior": float(model.weight_concentration_prior_),
        "mean_precision_prior": float(model.mean_precision_prior_),
        "mean_prior": model.mean_prior_.tolist(),
        "degrees_of_freedom_prior": float(model.degrees_of_freedom_prior_),
        "covariance_prior": prior.tolist(),
        "weights": model.weights_.tolist(),
        "means": model.means_.tolist(),
        "covariances": model.covariances_.tolist(),
        "mean_precision": model.mean_precision_.tolist(),
        "degrees_of_freedom": np.atleast_1d(model.degrees_of_freedom_).tolist(),
        # Dirichlet process: the two parameters of each stick's beta; else one Dirichlet parameter each
        "weight_concentration": [v.tolist() for v in model.weight_concentration_] if dp else [model.weight_concentration_.tolist()],
        "lower_bound": float(model.lower_bound_),
        # scikit-learn's score: ln of the sum of exp(E[ln weight] + E[ln Gaussian]), which is no density
        "score_samples": model.score_samples(at).tolist(),
        # the density of the mixture that `sample` draws from: sum of weights N(means, covariances)
        "ln_density": logsumexp(ln_terms, axis=0).tolist(),
    }


def responsibilities(rng, x, k):
    """Rows of k multiples of 1/64 that sum to 1 exactly, larger near to k rows of x taken at random."""
    anchors = x[rng.choice(len(x), k, replace=False)]
    distance = (((x[:, None] - anchors) / x.std(axis=0)) ** 2).sum(axis=2)
    p = np.exp(-distance / 2) + 0.02
    return rng.multinomial(64, p / p.sum(axis=1, keepdims=True)) / 64


def clusters(rng, n, centres, spread):
    d = len(centres[0])
    label = rng.integers(len(centres), size=n)
    shapes = [np.eye(d) * s + rng.normal(0, 0.3 * s, (d, d)) for s in spread]
    return np.array([np.array(centres[c]) + shapes[c] @ rng.normal(size=d) for c in label]).round(4)


def fits(x, resp, at, count=None):
    rows, initial = (x, resp) if count is None else (np.repeat(x, count, axis=0), np.repeat(resp, count, axis=0))
    return [
        record(fit(rows, initial, c, p, max_iter, tol), at)
        for c in COVARIANCE
        for p in CONCENTRATION
        for max_iter, tol in RUNS
    ]


def write(name, x, resp, at, count=None):
    data = {"x": x.tolist(), "resp": resp.tolist(), "at": at.tolist()}
    if count is not None:
        data["count"] = count.tolist()
    write_json(f"bayesian_mixture_{name}.json", {**data, "fits": fits(x, resp, at, count)})


rng = np.random.default_rng(20240)

x = clusters(rng, 120, [(0.2, 0.3), (0.7, 0.8), (0.8, 0.2)], [0.06, 0.1, 0.04])
write("2d", x, responsibilities(rng, x, 5), rng.uniform(-0.1, 1.1, (10, 2)).round(3))

x = clusters(rng, 80, [(0, 0, 1, 10), (3, -2, 0, 14)], [0.7, 1.1])
write("4d", x, responsibilities(rng, x, 3), (x[:10] + rng.normal(0, 1, (10, 4))).round(3))

rng = np.random.default_rng(4)
x = clusters(rng, 40, [(-3.0,), (4.0,)], [0.5, 0.8])
write("1d", x, responsibilities(rng, x, 2), np.linspace(-4, 5, 10)[:, None].round(3))

# Weighted: scikit-learn sees row i repeated count[i] times. Counts with mean 1, so that N w = count...
x = clusters(rng, 60, [(0.2, 0.3), (0.7, 0.8)], [0.1, 0.1])
resp, at = responsibilities(rng, x, 3), rng.uniform(-0.1, 1.1, (10, 2)).round(3)
count = rng.multinomial(60, rng.dirichlet(np.full(60, 0.8)))
write("weighted", x, resp, at, count)

# ... and with three times as many repeats as rows.
x = clusters(rng, 40, [(0, 0, 1), (3, -2, 0)], [0.7, 1.1])
resp, at = responsibilities(rng, x, 3), rng.uniform(-3, 4, (10, 3)).round(3)
count = rng.multinomial(120, rng.dirichlet(np.full(40, 1.0)))
write("weighted_3n", x, resp, at, count)

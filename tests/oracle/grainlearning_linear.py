"""GrainLearning's posterior on y = a x + b against the true one, after 1, 3, 5 and 8 iterations.

As in its linear tutorial: x = 0..119, a in 0.001..1, b in 0.001..10, truth 0.2 and 5, two components, full covariances,
every iteration as many new samples; but readings with Gaussian noise of known sd, and a sigma tolerance (1e-3 by default)
so low that it never stops and never replaces the sigma found. `slice` is its sampling option. `sd_ratio` is its weighted posterior sd of the
parameter over the closed form's (Gaussian, uniform prior), `mean_shift` its mean minus the true posterior's in true sd;
both are medians over `replicates` noise realisations, with the lowest and highest ratio. `sigma` and `ess` are the medians of
its sigma and of the effective sample size, as a fraction, reached with it (the target is 0.3). `within_90` is the share of replicates whose mean ± 1.645 sd holds the true parameter.
"""

import contextlib
import io
import warnings

import numpy as np
from grainlearning import BayesianCalibration
from grainlearning.dynamic_systems import DynamicSystem
from tables import write_table

warnings.simplefilter("ignore")

X = np.arange(120.0)
TRUTH = {"a": 0.2, "b": 5.0}
NOISE = 1.0
SAMPLES = [20, 100]
ESS = 0.3
REPORT = [1, 3, 5, 8]
REPLICATES = 10


def run(calibration):
    theta = calibration.system.param_data
    calibration.system.set_sim_data([[a * X + b] for a, b in theta])


def calibrate(y, samples, slice_sampling, seed):
    """Mean and sd of (a, b), sigma and effective sample size after every reported iteration."""
    np.random.seed(seed)
    calibration = BayesianCalibration.from_dict(
        {
            "num_iter": max(REPORT),
            "callback": run,
            "system": {
                "system_type": DynamicSystem,
                "param_names": ["a", "b"],
                "param_min": [0.001, 0.001],
                "param_max": [1.0, 10.0],
                "num_samples": samples,
                "obs_data": y,
                "ctrl_data": X,
                "sigma_tol": 1e-12,  # so that it does not stop
            },
            "inference": {
                "Bayes_filter": {"ess_target": ESS, "scale_cov_with_max": True},
                "sampling": {
                    "max_num_components": 2,
                    "covariance_type": "full",
                    "n_init": 1,
                    "random_state": seed,
                    "slice_sampling": slice_sampling,
                },
            },
        }
    )
    states = {}
    with contextlib.redirect_stdout(io.StringIO()):
        for iteration in range(1, max(REPORT) + 1):
            calibration.run_one_iteration()
            if iteration in REPORT:
                mean = calibration.system.estimated_params[-1]
                sd = calibration.system.estimated_params_cv[-1] * mean
                states[iteration] = (mean, np.abs(sd), calibration.system.sigma_max, calibration.inference.Bayes_filter.ess[-1, 0])
    return states


design = np.column_stack([X, np.ones_like(X)])
covariance = NOISE**2 * np.linalg.inv(design.T @ design)
true_sd = np.sqrt(np.diag(covariance))

rows = []
for samples, sampling in ((n, s) for n in SAMPLES for s in ("mixture", "slice")):
    found = {iteration: [] for iteration in REPORT}
    for seed in range(REPLICATES):
        y = TRUTH["a"] * X + TRUTH["b"] + np.random.default_rng(seed).normal(0, NOISE, len(X))
        best = np.linalg.lstsq(design, y, rcond=None)[0]
        for iteration, state in calibrate(y, samples, sampling == "slice", seed).items():
            found[iteration].append((*state, best))
    for iteration, states in found.items():
        mean, sd, sigma, ess, best = (np.array(column) for column in zip(*states))
        ratio, shift = sd / true_sd, (mean - best) / true_sd
        within = np.abs(mean - list(TRUTH.values())) <= 1.645 * sd
        for j, name in enumerate(TRUTH):
            statistics = [np.median(ratio[:, j]), ratio[:, j].min(), ratio[:, j].max(), np.median(shift[:, j])]
            statistics += [within[:, j].mean(), np.median(sigma), np.median(ess)]
            rows.append([samples, sampling, iteration, name, REPLICATES, *statistics])

write_table(
    "grainlearning_linear.tsv",
    "samples sampling iterations parameter replicates sd_ratio sd_ratio_low sd_ratio_high mean_shift within_90 sigma ess".split(),
    rows,
)

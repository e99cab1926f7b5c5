"""Drained triaxial compression of Li & Dafalias's sand (scipy.integrate.solve_ivp, LSODA), from the elastoplastic
stiffness in strains; the radial stress is p - q/3 of the integrated stresses. `case` 0 is the base model, 1 has a
membrane, cohesion, another void ratio and other base parameters; `q` is the reading, in kPa."""

from math import exp, radians, sin, tan

import numpy as np
from scipy.integrate import solve_ivp
from tables import write_table

PA, NU, CELL = 101.325, 0.05, 100.0
DIAMETER = 0.05
CASES = [
    dict(G0=125, phi_c=31, d0=0.9, h=0.7, membrane=0, c=0, e0=0.75),
    dict(G0=300, phi_c=35, d0=1.4, h=0.3, membrane=2, c=12, e0=0.67),
]


def rates(strain, state, G0, phi_c, d0, h, membrane, c, e0):
    p, q, e_v = state
    k = 2 * membrane / DIAMETER / 2  # radial stress per axial strain at no change of volume
    M = 6 * sin(radians(phi_c)) / (3 - sin(radians(phi_c)))
    e = e0 - (1 + e0) * e_v
    eta = q / (p + c / tan(radians(phi_c)))
    psi = e - (0.934 - 0.019 * (p / PA) ** 0.7)
    G = G0 * PA * (2.97 - e) ** 2 / (1 + e) * (p / PA) ** 0.5
    K = G * 2 * (1 + NU) / 3 / (1 - 2 * NU)
    D = d0 * (exp(3.5 * psi) - eta / M)
    # Plastic shear strain from d_eta = K_p/p de_q: alpha - beta de_v. Multiplied by eta, as K_p is infinite at first.
    loading = h * G * (M - eta * exp(1.1 * psi)) + eta * (3 * G - eta * K * D)
    alpha, beta = 3 * G * eta / loading, eta * (G + eta * K) / loading
    de_v = (k + G + alpha * (K * D - G)) / (K + G / 3 + k + beta * (K * D - G))
    plastic = alpha - beta * de_v
    return [K * (de_v - D * plastic), 3 * G * (1 - de_v / 3 - plastic), de_v]


rows = []
for case, parameters in enumerate(CASES):
    strains = 0.2 * (np.arange(41) / 40) ** 2
    solved = solve_ivp(
        rates, (0, 0.2), [CELL, 0, 0], "LSODA", strains, args=tuple(parameters.values()), rtol=1e-11, atol=1e-11
    )
    assert solved.success
    p, q, e_v = solved.y
    reading = q + (p - q / 3 - CELL) + 4 * parameters["membrane"] / DIAMETER * strains
    rows += zip([case] * len(strains), strains, reading, e_v)
write_table("triaxial.tsv", ["case", "e_a", "q", "e_v"], rows)

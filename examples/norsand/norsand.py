"""Drained triaxial compression of one element of NorSand.

    norsand.py NAME Gamma lambda M N chi H Ir nu p0 e0

writes NAME_sim.txt: axial strain e_a, deviatoric stress q in kPa, volumetric strain e_v (compression is positive). The parameters are
described in README.md; p0 is the cell pressure in kPa, e0 the void ratio at the start.

Jefferies (1993), Géotechnique 43:91; in the form of Jefferies & Been (2016), Soil Liquefaction, for triaxial compression, with an
elastic shear modulus in proportion to the pressure and no cap inside.
"""

import math
import sys

name = sys.argv[1]
Gamma, lam, M, N, chi, H, Ir, nu, p0, e0 = map(float, sys.argv[2:])
STEP, END, EVERY = 1e-4, 0.16, 0.0025  # plastic shear strain a step, axial strain at the end, and from record to record


def state(e, p_i):
    """State parameter at the image stress p_i of the yield surface."""
    return e - Gamma + lam * math.log(p_i)


def image_ratio(psi):
    """Stress ratio M_i at the image stress."""
    return M * (1 - N * chi * abs(psi) / M)


def on_the_surface(p, p_i, M_i):
    """Mean stress on the path dq = 3 dp at which q / p = M_i (1 - ln(p / p_i)), by Newton's method."""
    for _ in range(50):
        off = 3 * (1 - p0 / p) - M_i * (1 - math.log(p / p_i))
        next_p = max(p - off / (3 * p0 / p**2 + M_i / p), p / 2)
        if abs(next_p - p) < 1e-10 * p:
            return next_p
        p = next_p
    raise SystemExit("no stress on the yield surface")


bulk = Ir * 2 * (1 + nu) / (3 * (1 - 2 * nu))  # bulk modulus over pressure
p, e, p_i = p0, e0, p0 / math.e
strain, volume, recorded = 0.0, 0.0, -EVERY
with open(name + "_sim.txt", "w") as table:
    table.write("e_a q e_v\n")
    while True:
        if strain >= recorded + EVERY or strain >= END:
            table.write(f"{strain:.9g} {3 * (p - p0):.9g} {volume:.9g}\n")
            recorded = strain
        if strain >= END:
            break
        psi = state(e, p_i)
        M_i = image_ratio(psi)
        # Hardening towards the image stress that limits dilatancy to chi psi.
        p_i += STEP * H * (M_i / M) * (p / p_i) ** 2 * (p * math.exp(-chi * psi / M_i) - p_i)
        M_i = image_ratio(state(e, p_i))
        before, p = p, on_the_surface(p, p_i, M_i)
        eta = 3 * (1 - p0 / p)
        d_volume = (p - before) / (bulk * p) + (M_i - eta) * STEP
        strain += STEP + (p - before) / (Ir * p) + d_volume / 3
        volume += d_volume
        e -= (1 + e) * d_volume

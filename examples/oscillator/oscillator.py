"""A mass on a spring that is kicked twice, and what a linear model of it leaves out.

    oscillator.py NAME f zeta v1 v2 mu beta drag play

writes NAME_sim.txt: the time t in s and the displacement x in mm. Its parameters are described in the README.md of the example oscillator.
"""

import math
import sys

name = sys.argv[1]
f, zeta, v1, v2, mu, beta, drag, play = map(float, sys.argv[2:])
STEP, EVERY, READINGS = 1e-3, 50, 61  # s, steps a reading, readings
SECOND_KICK = 1500  # step at which it comes
omega = 2 * math.pi * f


def acceleration(x, v):
    """In m/s² at a displacement in m and a velocity in m/s."""
    stretched = math.copysign(max(abs(x) - play / 1000, 0), x)
    spring = -(omega**2) * stretched * (1 + beta * stretched**2)
    return spring - 2 * zeta * omega * v - mu * math.tanh(v / 1e-3) - drag * abs(v) * v


with open(name + "_sim.txt", "w") as table:
    table.write("t x\n")
    x, v = 0.0, v1
    for step in range((READINGS - 1) * EVERY + 1):
        if step % EVERY == 0:
            table.write(f"{step * STEP:.4g} {1000 * x:.9g}\n")
        if step == SECOND_KICK:
            v += v2
        # The classical Runge-Kutta method of fourth order.
        a1 = acceleration(x, v)
        va, a2 = v + STEP / 2 * a1, acceleration(x + STEP / 2 * v, v + STEP / 2 * a1)
        vb, a3 = v + STEP / 2 * a2, acceleration(x + STEP / 2 * va, v + STEP / 2 * a2)
        vc, a4 = v + STEP * a3, acceleration(x + STEP * vb, v + STEP * a3)
        x += STEP / 6 * (v + 2 * va + 2 * vb + vc)
        v += STEP / 6 * (a1 + 2 * a2 + 2 * a3 + a4)

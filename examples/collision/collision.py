"""Two equal elastic spheres pressed together: overlap u (m) and normal force f (N).

Hertz's law, f = 4/3 E* sqrt(R*) u^1.5 with R* = R/2 and E* = E / (2 (1 - nu^2)), so that the curve
knows E / (1 - nu^2) and nothing else of E and nu.
"""

import gl_yade

RADIUS = 1e-3
OVERLAP = 1e-5
STEPS = 80

p = gl_yade.parameters(E_m=9.3, nu=0.2)  # E_m is log10(E / Pa)

material = O.materials.append(FrictMat(young=10**p.E_m, poisson=p.nu, frictionAngle=0.4, density=2650))
for x in (0, 2 * RADIUS):
    O.bodies.append(sphere((x, 0, 0), RADIUS, material=material, fixed=True))

# Positions are imposed, so that there is nothing to integrate.
O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_Sphere_Aabb()], verletDist=0),
    InteractionLoop(
        [Ig2_Sphere_Sphere_ScGeom()],
        [Ip2_FrictMat_FrictMat_MindlinPhys()],
        [Law2_ScGeom_MindlinPhys_Mindlin()],
    ),
]
O.dt = 1e-6

u, f = [], []
for step in range(STEPS + 1):
    overlap = OVERLAP * step / STEPS
    O.bodies[1].state.pos = Vector3(2 * RADIUS - overlap, 0, 0)
    O.step()
    contacts = [i for i in O.interactions if i.isReal]
    u.append(overlap)
    f.append(contacts[0].phys.normalForce.norm() if contacts else 0.0)

gl_yade.write_run({'u': u, 'f': f})

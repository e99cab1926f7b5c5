"""Two equal spheres pressed together, released and pressed again, and sheared the more the deeper they
overlap: overlap u (m), normal force f (N) and tangential force t (N).

Mindlin's law with Coulomb's limit. What the base model lacks, each absent at 0:
* adhesion gamma, the surface energy in J/m² (Derjaguin, Muller & Toporov: a force of 4 pi R* gamma)
* damping beta, of the contact's normal and tangential motion, as a share of the critical one

The first cycle is slow and the second fast, so that adhesion, which is there at any speed, and
damping, which changes sign with the direction, can be told apart.
"""

from math import atan, sqrt

import gl_yade

RADIUS = 1e-3
OVERLAP = 1e-5
SHEAR = 0.6  # tangential over normal displacement at the deepest step
RECORDS = 120
SUBSTEPS = 10
SLOW, FAST = 1e-4, 0.2  # m/s
# Where each leg ends, as a share of OVERLAP, and how fast it goes.
LEGS = [(0.6, SLOW), (0.1, SLOW), (1.0, FAST), (0.0, FAST)]

p = gl_yade.parameters(E_m=9.3, nu=0.2, mu=0.4, gamma=0.0, beta=0.0)

material = O.materials.append(FrictMat(young=10**p.E_m, poisson=p.nu, frictionAngle=atan(p.mu), density=2650))
for x in (0, 2 * RADIUS):
    O.bodies.append(sphere((x, 0, 0), RADIUS, material=material, fixed=True))
moved = O.bodies[1].state

# Positions are imposed, so that there is nothing to integrate.
O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_Sphere_Aabb()], verletDist=0),
    InteractionLoop(
        [Ig2_Sphere_Sphere_ScGeom()],
        [Ip2_FrictMat_FrictMat_MindlinPhys(gamma=p.gamma, betan=p.beta, betas=p.beta)],
        [Law2_ScGeom_MindlinPhys_Mindlin(includeAdhesion=p.gamma > 0)],
    ),
]


def slide(u):
    return SHEAR * u**2 / OVERLAP


def move(start, end, speed):
    """Go from one overlap to another, and return the forces there."""
    O.dt = abs(end - start) / speed
    # On a circle, so that shearing leaves the overlap as it is.
    moved.pos = Vector3(sqrt((2 * RADIUS - end) ** 2 - slide(end) ** 2), slide(end), 0)
    moved.vel = Vector3(start - end, slide(end) - slide(start), 0) / O.dt
    O.step()
    for contact in O.interactions:
        if contact.isReal:
            # What Yade calls the normal force has the damping in it.
            return contact.phys.normalForce.dot(contact.geom.normal), -contact.phys.shearForce[1]
    return 0.0, 0.0


columns = {'u': [0.0], 'f': [0.0], 't': [0.0]}
here = 0.0
for to, speed in LEGS:
    to *= OVERLAP
    records = round(RECORDS * abs(to - here) / (3 * OVERLAP))
    path = [here + (to - here) * i / (records * SUBSTEPS) for i in range(records * SUBSTEPS + 1)]
    for i in range(1, len(path)):
        forces = move(path[i - 1], path[i], speed)
        if i % SUBSTEPS == 0:
            columns['u'].append(path[i])
            columns['f'].append(forces[0])
            columns['t'].append(forces[1])
    here = to

gl_yade.write_run(columns)

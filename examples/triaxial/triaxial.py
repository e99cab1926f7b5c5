"""Drained triaxial compression of a periodic packing of spheres.

The packing is compressed isotropically, and its contact friction lowered until it is as dense as
wanted; then it gets its real contact law, and is compressed axially at constant lateral stress.

Control: axial strain `e_z`. Observables: void ratio `e`, `s`, axial over lateral stress, and the volumetric strain
`e_v` since the compression began, positive where the specimen shrinks. Known of a test: the confining stress p0 in kPa.

What the base model lacks, each absent at 0 (but for the porosity):
* rolling resistance: kr (stiffness) and eta (strength), of the contact's own
* cohesion c: tensile strength of the contacts, as a multiple of the confining stress on their r²
* initial density: porosity n0
* membrane m: lateral stress that grows with lateral strain, m times the confining stress per strain
* piston offset d: friction of the piston, read as axial stress, as a multiple of the confining stress
The last two are of the apparatus: it reports its own confining stress, not that of the specimen.
"""

from math import atan
from zlib import crc32

import gl_yade

GRAINS = 500
STRAIN = 0.1
RECORDS = 50
# Contact friction in the isotropic compression, before it is lowered.
LOOSE = 0.5
# Small, for quasi-static loading.
INERTIAL_NUMBER = 2e-3

p = gl_yade.parameters(p0=100.0, mu=0.4, kr=0.5, eta=0.0, E_m=8.0, c=0.0, n0=0.41, m=0.0, d=0.0, seed=0)
CONFINING = 1e3 * p.p0

radius, density = 1e-3, 2650.0
rate = INERTIAL_NUMBER / (2 * radius * (density / CONFINING) ** 0.5)


def material(friction, rolling=0.0, strength=0.0, cohesion=0.0):
    return CohFrictMat(
        young=10**p.E_m, poisson=0.3, density=density, frictionAngle=atan(friction),
        isCohesive=cohesion > 0, normalCohesion=cohesion, shearCohesion=cohesion,
        momentRotationLaw=strength > 0, alphaKr=rolling, etaRoll=strength, alphaKtw=0, etaTwist=0,
    )  # fmt: skip


def use(new):
    """Give all grains a material; contacts are made anew, and keep their normal forces."""
    O.materials.append(new)
    for body in O.bodies:
        body.mat = new
    O.interactions.clear()


def porosity():
    return 1 - volume / O.cell.volume


def axial_strain():
    return 1 - O.cell.trsf[2, 2]


def lateral_strain():
    return (O.cell.trsf[0, 0] + O.cell.trsf[1, 1]) / 2 - 1


def settle(steps=500, unbalanced=0.005):
    """Run until the stress is the confining one and the grains are at rest."""
    for _ in range(200):
        O.run(steps, True)
        off = max(abs(getStress()[i, i] / CONFINING + 1) for i in range(3))
        if off < 0.01 and unbalancedForce() < unbalanced:
            return
    raise RuntimeError('the packing does not come to rest')


# A loose cloud, another one for each run and each confining stress unless a seed is given: the scatter between packings
# belongs to what a simulation can say. `key` would begin anew in each iteration.
name = O.tags['description'] if 'description' in O.tags.keys() else 'by hand'
seed = int(p.seed) or crc32(('%s %g' % (name, p.p0)).encode()) % 2**31
friction = LOOSE
O.periodic = True
side = 2 * radius * (GRAINS / 0.45) ** (1 / 3)
O.cell.hSize = Matrix3(side, 0, 0, 0, side, 0, 0, 0, side)
cloud = pack.SpherePack()
cloud.makeCloud((0, 0, 0), (side, side, side), rMean=radius, rRelFuzz=0.3, periodic=True, num=GRAINS, seed=seed)
O.materials.append(material(friction))
cloud.toSimulation(material=O.materials[0])
volume = sum(4 / 3 * pi * body.shape.radius**3 for body in O.bodies)

controller = PeriTriaxController(
    goal=(-CONFINING,) * 3, stressMask=7, dynCell=True, maxStrainRate=(10 * rate,) * 3,
    mass=density * volume, globUpdate=1, maxUnbalanced=0, relStressTol=1e-9,
)  # fmt: skip
O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_Sphere_Aabb()]),
    InteractionLoop(
        [Ig2_Sphere_Sphere_ScGeom6D()],
        [Ip2_CohFrictMat_CohFrictMat_CohFrictPhys(setCohesionOnNewContacts=True)],
        # Plastic moments are right in the incremental form only, and Yade says so at every contact.
        [Law2_ScGeom6D_CohFrictPhys_CohesionMoment(always_use_moment_law=True, useIncrementalForm=True)],
    ),
    controller,
    NewtonIntegrator(damping=0.2),
]
O.dt = 0.5 * PWaveTimeStep()
settle()
while porosity() > p.n0:
    friction *= 0.9
    if friction < 1e-3:
        raise RuntimeError('porosity %g cannot be reached, only %g' % (p.n0, porosity()))
    setContactFriction(atan(friction))
    O.run(100, True)
setContactFriction(atan(LOOSE))
settle()

use(material(p.mu, p.kr, p.eta, p.c * CONFINING))
O.run(10, True)
settle()
# Contacts of the compressed packing cohere; ones that form later do not.
O.engines[2].physDispatcher.functors[0].setCohesionOnNewContacts = False

O.cell.trsf = Matrix3.Identity
controller.stressMask = 3
controller.goal = (-CONFINING, -CONFINING, -1)
controller.maxStrainRate = (10 * rate, 10 * rate, rate)
columns = {'e_z': [], 'e': [], 's': [], 'e_v': []}
before = O.cell.volume
for record in range(RECORDS + 1):
    while axial_strain() < STRAIN * record / RECORDS:
        # Steps one by one: run(…, wait) sleeps between its looks at the clock.
        for _ in range(10):
            O.step()
        pressure = CONFINING * (1 + p.m * lateral_strain())
        controller.goal = (-pressure, -pressure, -1)
    columns['e_z'].append(axial_strain())
    columns['e'].append(porosity() / (1 - porosity()))
    columns['s'].append(-getStress()[2, 2] / CONFINING + p.d)
    columns['e_v'].append(1 - O.cell.volume / before)
gl_yade.write_run(columns)

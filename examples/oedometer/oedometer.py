"""Cyclic oedometric compression of a periodic packing of spheres, along a measured strain path.

A packing as dense as wanted is brought to the first measured stresses; then it is compressed along one axis, the
others held, from one turning point of the test to the next.

Control: axial strain `e_a`. Observables: axial stress `s_a` and lateral stress `s_r`, in MPa.

The base model: Hertz-Mindlin contacts of Young's modulus E_c (GPa) and friction mu, whose rolling is resisted by
a spring k_r (times E_c and the cubed mean radius) up to mu_r (times the normal force and the smaller diameter).
What it lacks, each absent at the value in brackets:
* density: porosity n0 of the grains at the first stress, where it is not that of the whole specimen [0.391]
* yielding of contacts: their mean pressure stays below p_y, in GPa [0, for none]
* grading: the radii are spread evenly up to a share g about their mean [0.33]
* friction of the side wall: by w times the lateral stress the piston bears more in loading, less in
  unloading, than the middle of the specimen; the record's alone [0]

All runs without the density and the grading begin with the packing of packing.txt, so that curves differ by the
parameters and not by the packing. It was made by this script, as the others are (`seed` chooses another one).
"""

import os
from math import atan

import gl_yade

GRAINS = 700
# Of the first reading, MPa.
FIRST_AXIAL, FIRST_LATERAL = 6.78105, 4.99043
# The measured turning points, and a little beyond the last reading.
TURNS = (0.0, 0.0169151309, 0.0108728497, 0.0172135082, 0.00892)
RECORD_EVERY = 1e-4
POISSON = 0.2
# Friction of the loose packing, before it is lowered.
LOOSE = 0.4
# What a packing still settles by when it has come to rest and has its own contacts, in porosity.
SETTLING = 0.0024
# Strain of a time step; with the time step it makes the inertial number.
STRAIN_STEP = 1.2e-5
# The way after a turn over which the friction of the wall changes sides, as a strain.
WALL_WAY = 2e-4
# Steps between two looks at stresses and contacts.
LOOK_EVERY = 25

p = gl_yade.parameters(
    E_c=130.0, mu=0.4, k_r=0.002, mu_r=0.2, n0=0.391, p_y=0.0, g=0.33, w=0.0, seed=1
)  # fmt: skip

radius, density = 30e-6, 2500.0
# Young's modulus with which packings are made, GPa.
MAKING = 130.0
contact_modulus = p.E_c * 1e9 / (2 * (1 - POISSON**2))
# Stiffness of the packing, MPa, of the order: for the servo only.
stiffness = 3000 * (p.E_c / 130) ** (2 / 3)


def stress():
    """Axial and two lateral stresses in MPa, compression positive."""
    tensor = getStress()
    return [-tensor[i, i] / 1e6 for i in (2, 0, 1)]


def porosity():
    return 1 - volume / O.cell.volume


def compress(axial, lateral1=0.0, lateral2=0.0):
    """Set the strain of a step, compression positive."""
    O.cell.velGrad = Matrix3(-lateral1, 0, 0, 0, -lateral2, 0, 0, 0, -axial) / O.dt


def step(steps):
    # Steps one by one: run(…, wait) sleeps between its looks at the clock.
    for _ in range(steps):
        O.step()


def servo(goal):
    """Move the cell towards these stresses, for a while."""
    compress(*(max(-3e-4, min(3e-4, (g - s) / stiffness / 50)) for g, s in zip(goal, stress())))
    step(LOOK_EVERY)


def settle(goal):
    """Bring the stresses to the goal, and the grains to rest."""
    for _ in range(1000):
        servo(goal)
        if max(abs(s / g - 1) for g, s in zip(goal, stress())) < 0.005 and unbalancedForce() < 0.01:
            return
    raise RuntimeError('the packing does not come to rest, at %s MPa' % stress())


def let_contacts_yield():
    """Keep the mean pressure of contacts below p_y, which Hertz's law does not know.

    Beyond the overlap at which it is reached the force grows as with that pressure (Thornton 1997). What Hertz's
    law has too much is taken away for good, as Yade takes an adhesion away, so that unloading leaves an overlap.
    """
    limit = p.p_y * 1e9
    for interaction in O.interactions:
        if not interaction.isReal:
            continue
        geometry, contact = interaction.geom, interaction.phys
        overlap = geometry.penetrationDepth
        reduced = 1 / (1 / geometry.refR1 + 1 / geometry.refR2)
        start = (3 * pi * limit / (4 * contact_modulus)) ** 2 * reduced
        if overlap > start:
            hertz = 4 / 3 * contact_modulus * reduced**0.5
            most = pi * limit * reduced * (overlap - start) + hertz * start**1.5
            contact.adhesionForce = max(contact.adhesionForce, hertz * overlap**1.5 - most)


def set_up(grains, sides, young, friction, contact, law, more=()):
    """Put grains, of position and radius, into the periodic cell."""
    global volume
    O.bodies.clear()
    O.interactions.clear()
    O.periodic = True
    O.cell.setBox(*sides)
    O.materials.append(
        FrictMat(young=young * 1e9, poisson=POISSON, density=density, frictionAngle=atan(friction))
    )
    O.bodies.append([sphere(position, size, material=O.materials[-1]) for position, size in grains])
    O.engines = [
        ForceResetter(),
        InsertionSortCollider([Bo1_Sphere_Aabb()]),
        InteractionLoop([Ig2_Sphere_Sphere_ScGeom()], [contact], [law]),
        *more,
        NewtonIntegrator(damping=0.3),
    ]
    volume = sum(4 / 3 * pi * size**3 for _, size in grains)
    # Hertzian contacts are softer than the grains.
    O.dt = 2 * PWaveTimeStep()


def make_packing():
    """A packing of the porosity n0 at the first mean stress: its grains and the sides of its cell."""
    side = 2 * radius * (GRAINS / 0.6) ** (1 / 3)
    cloud = pack.SpherePack()
    made = cloud.makeCloud(
        (0, 0, 0), (side,) * 3, rMean=radius, rRelFuzz=p.g, periodic=True, num=GRAINS, seed=int(p.seed)
    )
    if made < GRAINS:
        raise RuntimeError('only %d grains found room' % made)
    set_up(
        list(cloud), (side,) * 3, MAKING, LOOSE, Ip2_FrictMat_FrictMat_MindlinPhys(), Law2_ScGeom_MindlinPhys_Mindlin()
    )
    mean = (FIRST_AXIAL + 2 * FIRST_LATERAL) / 3
    while min(stress()) < 0.9 * mean:
        # Slower where grains touch.
        compress(*[1e-4 if avgNumInteractions() < 3 else 4e-5] * 3)
        step(LOOK_EVERY)
    friction = LOOSE
    while porosity() > p.n0 + SETTLING:
        friction *= 0.96
        if friction < 1e-3:
            raise RuntimeError('porosity %g cannot be reached, only %g' % (p.n0, porosity()))
        setContactFriction(atan(friction))
        servo([mean] * 3)
    setContactFriction(atan(LOOSE))
    settle([mean] * 3)
    return [(O.cell.wrap(body.state.pos), body.shape.radius) for body in O.bodies], O.cell.size


def kept_packing():
    """The packing of packing.txt, whose first row are the sides of its cell."""
    with open(os.path.join(os.environ.get('CASE', '.'), 'packing.txt')) as file:
        rows = [[float(field) for field in line.split()] for line in file]
    return [(Vector3(*row[:3]), row[3]) for row in rows[1:]], Vector3(*rows[0][:3])


is_kept = (p.n0, p.g, int(p.seed)) == (0.391, 0.33, 1) and not os.environ.get('MAKE_PACKING')
grains, sides = kept_packing() if is_kept else make_packing()
if os.environ.get('MAKE_PACKING'):
    with open(os.environ['MAKE_PACKING'], 'w') as file:
        for *position, size in [(*sides, 0.0)] + [(*position, size) for position, size in grains]:
            print(*('%.9g' % value for value in (*position, size)), file=file)
more = [PyRunner(command='let_contacts_yield()', iterPeriod=LOOK_EVERY)] if p.p_y > 0 else []
set_up(
    grains, sides, p.E_c, p.mu,
    Ip2_FrictMat_FrictMat_MindlinPhys(krot=p.k_r * p.E_c * 1e9 * radius**3, eta=p.mu_r, gamma=0),
    Law2_ScGeom_MindlinPhys_Mindlin(includeMoment=True, includeAdhesion=p.p_y > 0), more,
)  # fmt: skip
step(1)

# The stresses of the first reading, in the middle of the specimen.
settle([FIRST_AXIAL - p.w * FIRST_LATERAL, FIRST_LATERAL, FIRST_LATERAL])

columns = {'e_a': [], 's_a': [], 's_r': []}
strain, wall = 0.0, 1.0
height = O.cell.hSize[2, 2]


def record():
    axial, *laterals = stress()
    lateral = sum(laterals) / 2
    for column, value in zip(columns.values(), (strain, axial + p.w * wall * lateral, lateral)):
        column.append(round(value, 8))


record()
for start, end in zip(TURNS, TURNS[1:]):
    marks = int(abs(end - start) / RECORD_EVERY) + 1
    for mark in range(1, marks + 1):
        before, goal = strain, start + (end - start) * mark / marks
        steps = max(1, round(abs(goal - strain) / STRAIN_STEP))
        compress((goal - strain) / steps / (1 - strain))
        step(steps)
        strain = 1 - O.cell.hSize[2, 2] / height
        wall = max(-1.0, min(1.0, wall + 2 * (strain - before) / WALL_WAY))
        record()
gl_yade.write_run(columns)

"""Cyclic oedometric compression of a periodic packing of spheres, along a measured strain path.

A packing is made at the first measured stresses, as dense as wanted; then it is compressed along one
axis, the others held, from one turning point of the test to the next.

Control: axial strain `e_a`. Observables: axial stress `s_a` and lateral stress `s_r`, in MPa.

The base model: Hertz-Mindlin contacts of Young's modulus E_c (GPa) and friction mu, whose rolling is resisted by
a spring k_r (times E_c and the cubed mean radius) up to mu_r (times the normal force and the smaller diameter).
What it lacks, each absent at the value in brackets:
* density: porosity n0 of the grains at the first stress, where it is not that of the whole specimen [0.391]
* yielding of contacts: their mean pressure stays below p_y, in GPa [0, for none]
* roughness: height h_r of asperities that make a contact soft at first, in mean radii [0]
* grading: the radii are spread evenly up to a share g about their mean [0.33]
* friction of the side wall: by w times the lateral stress the piston bears more in loading, less in
  unloading, than the middle of the specimen; the record's alone [0]
"""

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
# What the packing still settles by when its friction is back, in porosity.
SETTLING = 0.0017
# Strain of a time step; with the time step it makes the inertial number.
STRAIN_STEP = 1.2e-5
# The way after a turn over which the friction of the wall changes sides, as a strain.
WALL_WAY = 2e-4
# Steps between two looks at stresses and contacts.
LOOK_EVERY = 25

p = gl_yade.parameters(
    E_c=110.0, mu=0.36, k_r=0.02, mu_r=0.3, n0=0.391, p_y=0.0, h_r=0.0, g=0.33, w=0.0, seed=0
)  # fmt: skip

radius, density = 30e-6, 2500.0
young = p.E_c * 1e9
contact_modulus = young / (2 * (1 - POISSON**2))
# Stiffness of the packing, MPa, of the order: for the servo only.
stiffness = 3000 * (p.E_c / 110) ** (2 / 3)


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


def adjust_contacts():
    """Let contacts yield, and be rough: what Hertz's law does not know.

    Beyond the overlap at which the mean pressure is p_y the force grows as with that pressure (Thornton
    1997); what Hertz's law has too much is taken away for good, as Yade takes an adhesion away, so that
    unloading leaves an overlap. Asperities of height h make the force that of Hertz times d / (d + h).
    """
    for interaction in O.interactions:
        if not interaction.isReal:
            continue
        geometry, contact = interaction.geom, interaction.phys
        overlap = geometry.penetrationDepth
        if overlap <= 0:
            continue
        reduced = 1 / (1 / geometry.refR1 + 1 / geometry.refR2)
        hertz = 4 / 3 * contact_modulus * reduced**0.5
        if p.h_r > 0:
            hertz *= overlap / (overlap + p.h_r * radius)
            contact.kno = hertz
        if p.p_y > 0:
            limit = p.p_y * 1e9
            start = (3 * pi * limit / (4 * contact_modulus)) ** 2 * reduced
            if overlap > start:
                most = pi * limit * reduced * (overlap - start) + 4 / 3 * contact_modulus * reduced**0.5 * start**1.5
                contact.adhesionForce = max(contact.adhesionForce, hertz * overlap**1.5 - most)


# A cloud of its own for each run unless a seed is given: the scatter between packings belongs to what
# a simulation can say.
seed = int(p.seed) or int(p.key) + 1
side = 2 * radius * (GRAINS / 0.6) ** (1 / 3)
O.periodic = True
O.cell.hSize = Matrix3(side, 0, 0, 0, side, 0, 0, 0, side)
cloud = pack.SpherePack()
made = cloud.makeCloud((0, 0, 0), (side, side, side), rMean=radius, rRelFuzz=p.g, periodic=True, num=GRAINS, seed=seed)
if made < GRAINS:
    raise RuntimeError('only %d grains found room' % made)
O.materials.append(FrictMat(young=young, poisson=POISSON, density=density, frictionAngle=atan(LOOSE)))
cloud.toSimulation(material=O.materials[0])
volume = sum(4 / 3 * pi * body.shape.radius**3 for body in O.bodies)

law = Law2_ScGeom_MindlinPhys_Mindlin(includeAdhesion=p.p_y > 0)
O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_Sphere_Aabb()]),
    InteractionLoop(
        [Ig2_Sphere_Sphere_ScGeom()],
        [Ip2_FrictMat_FrictMat_MindlinPhys(krot=p.k_r * young * radius**3, eta=p.mu_r, gamma=0)],
        [law],
    ),
    NewtonIntegrator(damping=0.3),
]
if p.h_r > 0 or p.p_y > 0:
    O.engines = O.engines[:3] + [PyRunner(command='adjust_contacts()', iterPeriod=LOOK_EVERY)] + O.engines[3:]
# Hertzian contacts are softer than the grains.
O.dt = 2 * PWaveTimeStep()

# The stresses of the first reading, in the middle of the specimen.
first = [FIRST_AXIAL - p.w * FIRST_LATERAL, FIRST_LATERAL, FIRST_LATERAL]
while min(s / f for s, f in zip(stress(), first)) < 0.9:
    # Slower where grains touch.
    compress(*[1e-4 if avgNumInteractions() < 3 else 4e-5] * 3)
    step(LOOK_EVERY)
friction = LOOSE
while porosity() > p.n0 + SETTLING:
    friction *= 0.96
    if friction < 1e-3:
        raise RuntimeError('porosity %g cannot be reached, only %g' % (p.n0, porosity()))
    setContactFriction(atan(friction))
    servo(first)
setContactFriction(atan(p.mu))
law.includeMoment = True
settle(first)

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

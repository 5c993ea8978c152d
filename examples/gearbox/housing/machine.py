#!/usr/bin/env python3
"""The gearbox with 101 gauges on its housing: python3 machine.py > machine.toml

Delta rosettes of -45, 0 and 45 degrees as in table 1 of Bosmans et al. 2023: 17
channels on the torque arm, 55 on the ring gear, 29 on the high-speed housing;
channels of the last rosette of each group that do not fit in are left out, as
those that failed on the test bench. Positions belong to housing.geo.
"""
from math import cos, radians, sin

FRONT, REAR = 0.38, 0.72        # inner faces of the walls: where the bearings' forces act

print(f'''# Made by machine.py: the gearbox of ../machine.toml with the gears and bearings of its
# three stages and with 101 gauges. Maps: `make` in this folder.

format = 1
name = "850 kW gearbox, 101 gauges"
rate_hz = 500

[drivetrain]
carrier = "main_shaft"
nominal_speed_rad_s = 2.72

[[drivetrain.inertia]]
name = "main_shaft"
moment_kg_m2 = 3.0e5
drag_nm_s_per_rad = 1100

[[drivetrain.inertia]]
name = "high_speed_shaft"
moment_kg_m2 = 40
speed_ratio = 61.8
drag_nm_s_per_rad = 0.3

[[drivetrain.shaft]]
name = "gearbox"
stiffness_nm_per_rad = 4.0e7
damping_nm_s_per_rad = 4.0e4

[[drivetrain.load]]
name = "main_shaft"
inertia = "main_shaft"
direction = "drives"
nominal_nm = 312e3

[[drivetrain.load]]
name = "high_speed_shaft"
inertia = "high_speed_shaft"
direction = "brakes"
nominal_nm = 5050

[drivetrain.gears.planetary]
planets = 3
sun_teeth = 18
ring_teeth = 90
normal_module_m = 0.011
pressure_angle_deg = 20
helix_angle_deg = 7
contact_ratio = 2.5

[[drivetrain.gears.helical]]
wheel_teeth = 103
pinion_teeth = 28
normal_module_m = 0.008
pressure_angle_deg = 20
helix_angle_deg = 10
z_m = 0.48
pinion_at_deg = 20

[[drivetrain.gears.helical]]
wheel_teeth = 70
pinion_teeth = 25
normal_module_m = 0.006
pressure_angle_deg = 20
helix_angle_deg = -12
z_m = 0.62
pinion_at_deg = -80
''')
for shaft, name in enumerate(["sun", "middle", "fast"]):
    for side, z in (("front", FRONT), ("rear", REAR)):
        print(f'''[[drivetrain.gears.bearing]]
name = "{name} {side}"
shaft = {shaft}
z_m = {z}
locating = {str(side == "rear").lower()}
''')
print('''[[encoder]]
name = "encoder_main"
inertia = "main_shaft"
counts_per_turn = 16384

[index]
name = "index"
encoder = "encoder_main"
angle_rad = 0.5

[[reference]]
name = "torque_main"
load = "main_shaft"
unit = "Nm"

[[reference]]
name = "torque_hss"
load = "high_speed_shaft"
unit = "Nm"
''')


def rosette(position, along, across):
    """Directions of the three grids in the plane of two unit vectors."""
    r = 0.5 ** 0.5
    return [(position, [r * (a + s * b) if s else a for a, b in zip(along, across)]) for s in (-1, 0, 1)]


def on_ring(degrees, z):
    c, s = cos(radians(degrees)), sin(radians(degrees))
    return rosette([0.6 * c, 0.6 * s, z], [-s, c, 0], [0, 0, 1])


groups = {
    # On top and below of both arms, and on their front.
    ("torque arm", "ta", 17): [
        rosette([x, y, -0.21], [1, 0, 0], [0, 0, 1])
        for x, y in ((-0.8, 0.15), (0.8, 0.15), (-0.8, -0.15), (0.8, -0.15))
    ] + [rosette([x, 0.08, -0.28], [1, 0, 0], [0, 1, 0]) for x in (-0.75, 0.75)],
    # Twelve places on the mid-plane, and seven off it.
    ("ring gear", "rg", 55): [on_ring(15 + 30 * k, 0.0) for k in range(12)]
    + [on_ring(5 + 51 * k, 0.06) for k in range(7)],
    # Around the bearings, on the outer faces of the walls, and on the neck.
    ("high-speed housing", "hsh", 29): [
        rosette([x, y, z], [1, 0, 0], [0, 1, 0])
        for z in (0.32, 0.78)
        for x, y in ((0.68, 0.30), (0.30, 0.30), (0.70, -0.20), (0.30, -0.20))
        if z > 0.5 or x * x + y * y > 0.43
    ] + [on_ring(20 + 90 * k, 0.22) for k in range(4)],
}
for (group, prefix, count), rosettes in groups.items():
    channels = [channel for grids in rosettes for channel in grids]
    for i, (position, direction) in enumerate(channels[:count], 1):
        vector = lambda values: ", ".join(f"{value:.5f}" for value in values)
        print(f'''[[channel]]
name = "{prefix}{i}"
unit = "m/m"
senses = {{ shaft = "gearbox" }}
sensitivity_map = "maps.csv"
patch_map = "patches.csv"
place = {{ position_m = [{vector(position)}], direction = [{vector(direction)}], patch_m = 0.06 }}
noise_std = 0.3e-6
group = "{group}"
adc = {{ lsb = 9.313225746154785e-10, stuck_after = 20 }}
''')
print('''[[sensor_set]]
name = "ring-gear-5"
channels = ["rg2", "rg8", "rg14", "rg20", "rg26"]
''')

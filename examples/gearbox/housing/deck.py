#!/usr/bin/env python3
"""Decks for CalculiX and their load cases, from the mesh and the machine.

    python3 deck.py unit            unit.inp, loads.csv: a unit load in each step
    python3 deck.py direct COUNT    direct.inp: all forces at COUNT carrier angles, a step each

The second is the reference for the reduced maps: it shares nothing with
`loadtwin reduce`, but takes the forces from an equilibrium of its own and puts
each planet's between the nodes of the mesh, by the shape functions of the edge
on which it stands.
"""
import os
import sys
import tomllib
from math import atan2, cos, degrees, dist, pi, radians, sin, tan, tau

machine = tomllib.load(open("machine.toml", "rb"))
gears = machine["drivetrain"]["gears"]
bearings = gears["bearing"]


PARTS = 400         # of the arc over which a planet's force is spread


def read_mesh():
    """Nodes and node sets; writes mesh of solids alone to solids.inp."""
    nodes, sets, kept, kind, name, keep = {}, {}, [], None, None, True
    for line in open("mesh.inp"):
        if line.startswith("*"):
            key = line.upper().replace(" ", "")
            name = line.split("=")[-1].strip()
            kind = next((k for k in ("*NODE", "*ELEMENT", "*NSET", "*ELSET", "*HEADING") if key.startswith(k)), None)
            keep = {"*ELEMENT": "C3D10" in key, "*ELSET": name in ("housing", "bearings")}.get(kind, kind is not None)
        elif kind == "*NODE" and line.strip():
            number, *position = line.split(",")
            nodes[int(number)] = tuple(map(float, position))
        elif kind == "*NSET":
            sets.setdefault(name, []).extend(int(n) for n in line.replace(" ", "").strip().split(",") if n)
        if keep:
            kept.append(line)
    # Whole at any time: both decks may be made at once.
    part = f"solids.{os.getpid()}"
    open(part, "w").writelines(kept)
    os.replace(part, "solids.inp")
    return nodes, sets


nodes, sets = read_mesh()
angle = {n: round(degrees(atan2(nodes[n][1], nodes[n][0])), 6) % 360 for n in sets["contact"]}
ring = sorted(sets["contact"], key=angle.get)
seat = [sets[f"bearing{i}"][0] for i in range(len(bearings))]
gauges = {tuple(c["place"]["position_m"]): c["place"]["patch_m"] for c in machine["channel"]}
# Nodes on the surface around each gauge; the geometry has no node set of the surface
# that would not hold inner edges too, so faces of one element alone are looked for.
surface = set()


def faces():
    count, element, corner = {}, None, False
    for line in open("solids.inp"):
        if line.startswith("*"):
            corner = line.upper().startswith("*ELEMENT")
            pending = []
        elif corner:
            pending += [int(n) for n in line.replace(" ", "").strip().split(",") if n]
            if len(pending) >= 11:
                a, b, c, d, ab, bc, ca, ad, bd, cd = pending[1:11]
                for face in ((a, b, c, ab, bc, ca), (a, b, d, ab, bd, ad), (b, c, d, bc, cd, bd), (a, c, d, ca, cd, ad)):
                    count.setdefault(tuple(sorted(face)), []).append(face)
                pending = []
    return [same[0] for same in count.values() if len(same) == 1]


for face in faces():
    surface.update(face)
# A node in the middle of an edge is no corner of any element.
middle = {n for face in faces() for n in face[3:]}
patch = sorted(n for n in surface if any(dist(nodes[n], p) <= r for p, r in gauges.items()))

MODEL = f"""*INCLUDE, INPUT=solids.inp
*NSET, NSET=GAUGES
{chr(10).join(f'{n},' for n in patch)}
*MATERIAL, NAME=IRON
*ELASTIC
1.7E11, 0.28
*DENSITY
7100
*MATERIAL, NAME=BEARING
*ELASTIC
1.0E10, 0.3
*DENSITY
7800
*SOLID SECTION, ELSET=housing, MATERIAL=IRON
*SOLID SECTION, ELSET=bearings, MATERIAL=BEARING
*BOUNDARY
left, 1, 3
right, 2, 3
"""
OUTPUT = "*EL FILE, NSET=GAUGES\nE\n*END STEP\n"


def unit():
    """One factorisation, one back-substitution for each unit force; on the ring at every node of the contact."""
    with open("unit.inp", "w") as deck, open("loads.csv", "w") as loads:
        deck.write(MODEL + "*STEP\n*GREEN\n*CLOAD\n")
        loads.write("place,angle [deg],axis\n")
        for node, place, where in [(n, "ring", angle[n]) for n in ring] + [
            (n, bearing["name"], "") for n, bearing in zip(seat, bearings)
        ]:
            for number, axis in enumerate("xyz", 1):
                deck.write(f"{node}, {number}, 1.\n")
                loads.write(f"{place},{where},{axis}\n")
        deck.write(OUTPUT)


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def bearing_forces():
    """Forces on the seats per N m at the carrier, by summing moments about each seat."""
    p = gears["planetary"]
    share = p["sun_teeth"] / (p["sun_teeth"] + p["ring_teeth"])
    beta = radians(p["helix_angle_deg"])
    sun_radius = p["normal_module_m"] * p["sun_teeth"] / 2 / cos(beta)
    on_shaft = [[([0, 0, 0], [0, 0, share / sun_radius * tan(beta)])]]
    torque, axis = share, [0.0, 0.0]
    for stage in gears.get("helical", []):
        alpha, beta = radians(stage["pressure_angle_deg"]), radians(stage["helix_angle_deg"])
        towards = [cos(radians(stage["pinion_at_deg"])), sin(radians(stage["pinion_at_deg"])), 0]
        wheel, pinion = (stage["normal_module_m"] * stage[k] / 2 / cos(beta) for k in ("wheel_teeth", "pinion_teeth"))
        forward = [-towards[1], towards[0], 0]
        push = -torque / wheel
        force = [push * f - abs(push) * tan(alpha) / cos(beta) * t for f, t in zip(forward, towards)]
        force[2] = -push * tan(beta)
        on_shaft[-1].append(([wheel * t for t in towards[:2]] + [stage["z_m"]], force))
        on_shaft.append([([-pinion * t for t in towards[:2]] + [stage["z_m"]], [-f for f in force])])
        torque *= -pinion / wheel
    result = []
    for bearing in bearings:
        other = next(b for b in bearings if b["shaft"] == bearing["shaft"] and b is not bearing)
        force, moment = [0, 0, 0], [0, 0, 0]
        for place, f in on_shaft[bearing["shaft"]]:
            arm = [place[0], place[1], place[2] - other["z_m"]]
            moment = [m + c for m, c in zip(moment, cross(arm, f))]
            force[2] += f[2]
        span = bearing["z_m"] - other["z_m"]
        result.append([moment[1] / span, -moment[0] / span, force[2] if bearing["locating"] else 0])
    return result


def direct(count):
    p = gears["planetary"]
    beta = radians(p["helix_angle_deg"])
    radius = p["normal_module_m"] * p["ring_teeth"] / 2 / cos(beta)
    t = p["ring_teeth"] / (p["sun_teeth"] + p["ring_teeth"]) / radius / p["planets"]
    r, a = t * tan(radians(p["pressure_angle_deg"])) / cos(beta), -t * tan(beta)
    step = 360 / len(ring)
    arc = 360 * p["contact_ratio"] / p["ring_teeth"]
    first = next(i for i, n in enumerate(ring) if n not in middle)
    seats = bearing_forces()
    with open("direct.inp", "w") as deck:
        deck.write(MODEL)
        for i in range(count):
            # Not where a contact stands on a node, but anywhere between.
            carrier = 360 * (i + 0.37) / count if count < 360 else i
            loads = {n: list(f) for n, f in zip(seat, seats)}
            for k in range(p["planets"]):
                phi = carrier + 360 * k / p["planets"]
                c, s = cos(radians(phi)), sin(radians(phi))
                force = (r * c - t * s, r * s + t * c, a)
                for part in range(PARTS):
                    at = phi + arc * ((part + 0.5) / PARTS - 0.5)
                    place = (at - angle[ring[first]]) % 360 / (2 * step)
                    edge, x = int(place), 2 * (place % 1) - 1
                    for j, weight in enumerate((x * (x - 1) / 2, 1 - x * x, x * (x + 1) / 2)):
                        node = ring[(first + 2 * edge + j) % len(ring)]
                        old = loads.setdefault(node, [0, 0, 0])
                        loads[node] = [o + weight / PARTS * f for o, f in zip(old, force)]
            deck.write("*STEP\n*STATIC\n*CLOAD, OP=NEW\n")
            for node, force in loads.items():
                for number, f in enumerate(force, 1):
                    deck.write(f"{node}, {number}, {1e3 * f!r}\n")
            deck.write(OUTPUT)
    with open("direct.csv", "w") as angles:
        angles.write("carrier_angle [deg]\n")
        for i in range(count):
            angles.write(f"{360 * (i + 0.37) / count if count < 360 else i}\n")


if __name__ == "__main__":
    unit() if sys.argv[1] == "unit" else direct(int(sys.argv[2]))

#!/usr/bin/env python3
"""Sensitivity of each gauge of the example gearbox over the carrier angle.

    python3 sensitivity.py > sensitivity.csv

An analytic stand-in for a reduced finite-element model of the housing:

* ring gear: the rim is a beam on an elastic foundation (Hetenyi 1946) under
  three planets, e^(-x) (cos x - sin x) with x = |angle| / 10 degrees, rounded
  by contact over 2 degrees, and a part from the tangential force that has the
  other sign on the other side of the planet;
* torque arm: in proportion to the reaction torque, with the ripple of three
  planets and its second harmonic;
* high-speed housing: in proportion to the bearing forces, nearly constant.
"""
from math import cos, exp, pi, radians, sin, tau

NOMINAL_NM = 312e3
ENTRIES = 512

# Strain at nominal torque [m/m] and angular position [degrees].
TORQUE_ARM = {"ta1": (104e-6, 0), "ta2": (-98e-6, 60), "ta3": (91e-6, 20),
              "ta4": (-87e-6, 75), "ta5": (80e-6, 45)}
RING_GEAR = {"rg1": (215e-6, 12), "rg2": (206e-6, 55), "rg3": (198e-6, 101),
             "rg4": (191e-6, 158), "rg5": (185e-6, 205)}
HOUSING = {"hsh1": (48e-6, 0), "hsh2": (-41e-6, 40), "hsh3": (36e-6, 80)}


def wrapped(angle):
    return (angle + pi) % tau - pi


def rim(angle):
    x = abs(angle) / radians(10)
    bending = exp(-x) * (cos(x) - sin(x))
    tangential = -0.08 * (1 if angle > 0 else -1) * exp(-x) * sin(x)
    return bending + tangential


def rounded(function, angle, width=radians(2), half=12):
    weights = [exp(-0.5 * (3 * k / half) ** 2) for k in range(-half, half + 1)]
    shifts = [3 * width * k / half for k in range(-half, half + 1)]
    return sum(w * function(angle + s) for w, s in zip(weights, shifts)) / sum(weights)


PEAK = rounded(rim, 0.0)


def ring_gear(angle, peak, position):
    loads = (wrapped(angle + planet * tau / 3 - position) for planet in range(3))
    return peak * sum(rounded(rim, load) / PEAK for load in loads)


def torque_arm(angle, mean, position):
    x = 3 * (angle - position)
    return mean * (1 + 0.045 * cos(x) + 0.015 * cos(2 * x + 0.7))


def housing(angle, mean, position):
    return mean * (1 + 0.012 * cos(3 * (angle - position)) + 0.006 * cos(angle - position))


gauges = [(name, function, strain / NOMINAL_NM, radians(position))
          for group, function in ((TORQUE_ARM, torque_arm), (RING_GEAR, ring_gear), (HOUSING, housing))
          for name, (strain, position) in group.items()]
print("carrier_angle [rad]", *(f"{name} [m/m/Nm]" for name, *_ in gauges), sep=",")
for i in range(ENTRIES):
    angle = i * tau / ENTRIES
    print(f"{angle:.9f}", *(f"{f(angle, s, p):.6e}" for _, f, s, p in gauges), sep=",")

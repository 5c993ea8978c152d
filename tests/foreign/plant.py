"""Simulates a test bench that shares no code and no form of an effect with loadtwin, and writes its recordings and
the description that its user would have.

A motor turns a gear and a brake over two shafts; four gauges on the gear's housing read the torque of the first shaft,
two on a flange that of the second. True parameters differ from the description by what machines differ by.
"""

import math
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

RATE_HZ = 500
STEPS = 8  # of the simulation, a sample
NOMINAL_NM = 500.0
NOMINAL_RAD_S = 100.0
GAUGES = [f"housing_{i}" for i in range(1, 5)] + ["flange_1", "flange_2"]
COUNTS = {"encoder_motor": 8192, "encoder_brake": 4096}

# What the product may call each effect.
NAMES = {
    "gain": {"gain-error"},
    "friction": {"coulomb-friction", "stribeck-friction", "presliding-hysteresis", "load-friction", "viscous-friction"},
    "creep": {"gauge-creep"},
    "warmth": {"thermal-drift"},
    "bend": {"strain-nonlinearity"},
    "late": {"channel-delay"},
    "loose": {"gauge-debonding"},
    "backlash": {"backlash"},
    "bursts": set(),  # outside the library
}


class Bench:
    """One individual: true parameters, and the description of it."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        off = lambda std: float(np.clip(1 + std * rng.standard_normal(), 0.7, 1.3))
        self.inertia = [1.5 * off(0.05), 0.2 * off(0.05), 2.0 * off(0.05)]
        self.stiffness = [9e4 * off(0.1), 6e4 * off(0.1)]
        self.damping = [8.0 * off(0.3), 6.0 * off(0.3)]
        self.drag = 0.02 * off(0.3)
        # Strain at 1 N m, and its orders over the angle of the motor.
        self.sensitivity = [(1.2e-7 if i < 4 else 8e-8) * (-1) ** i for i in range(6)]
        self.true_gain = [off(0.02) for _ in GAUGES]
        self.orders = [
            [(0.01 * rng.standard_normal(), rng.uniform(0, math.tau), k) for k in (1, 2)] if i < 4 else []
            for i in range(6)
        ]
        self.zero = 3e-6 * rng.standard_normal(6)

    def describe(self, folder):
        """Writes the description that the user has, and gives its path."""
        stiffness = 1 / (1 / 9e4 + 1 / 6e4)
        text = f"""format = 1
name = "test bench"
rate_hz = {RATE_HZ}
[drivetrain]
carrier = "motor"
nominal_speed_rad_s = {NOMINAL_RAD_S}
[[drivetrain.inertia]]
name = "motor"
moment_kg_m2 = 1.6
drag_nm_s_per_rad = 0.01
[[drivetrain.inertia]]
name = "brake"
moment_kg_m2 = 2.1
drag_nm_s_per_rad = 0.01
[[drivetrain.shaft]]
name = "shaft"
stiffness_nm_per_rad = {stiffness}
damping_nm_s_per_rad = 4
[[drivetrain.load]]
name = "motor"
inertia = "motor"
direction = "drives"
nominal_nm = {NOMINAL_NM}
[[drivetrain.load]]
name = "brake"
inertia = "brake"
direction = "brakes"
nominal_nm = {NOMINAL_NM}
[index]
name = "index"
encoder = "encoder_motor"
angle_rad = 0.0
[[reference]]
name = "torque_motor"
load = "motor"
unit = "Nm"
[[reference]]
name = "torque_brake"
load = "brake"
unit = "Nm"
[[auxiliary]]
name = "temperature"
unit = "°C"
adc = {{ lsb = 0.01 }}
"""
        for name, inertia in (("encoder_motor", "motor"), ("encoder_brake", "brake")):
            text += f'[[encoder]]\nname = "{name}"\ninertia = "{inertia}"\ncounts_per_turn = {COUNTS[name]}\n'
        for i, name in enumerate(GAUGES):
            text += f"""[[channel]]
name = "{name}"
unit = "m/m"
senses = {{ shaft = "shaft" }}
sensitivity_map = "maps.csv"
noise_std = 3e-7
group = "{name[:-2]}"
late_s = 0.002  # filter of the amplifier
adc = {{ lsb = 1e-8 }}
"""
        for group, count in (("housing", 4), ("flange", 2)):
            names = ", ".join(f'"{group}_{i}"' for i in range(1, count + 1))
            text += f'[[sensor_set]]\nname = "{group}"\nchannels = [{names}]\nencoders = ["encoder_motor"]\n'
        folder = Path(folder)
        (folder / "machine.toml").write_text(text)
        with open(folder / "maps.csv", "w") as file:
            file.write("carrier_angle [rad]," + ",".join(f"{name} [m/m/Nm]" for name in GAUGES) + "\n")
            for k in range(72):
                values = ",".join(f"{s:.6e}" for s in self.sensitivity)
                file.write(f"{k * math.tau / 72:.9f},{values}\n")
        return folder / "machine.toml"


def course(profile, seed):
    """Speed [rad/s] and brake torque [N m] over time, each sample."""
    rng = np.random.default_rng(seed)
    seconds = 40 if profile == "constant" else 60
    t = np.arange(seconds * RATE_HZ) / RATE_HZ
    ramp = lambda start, length: np.clip((t - start) / length, 0, 1)
    if profile == "constant":
        speed, torque = ramp(1, 4), ramp(3, 5)
    elif profile == "cycle":
        speed = ramp(1, 8) - 1.4 * ramp(34, 8) + 0.4 * ramp(50, 6)
        torque = ramp(4, 9) - 1.3 * ramp(30, 5) + 0.3 * ramp(48, 3)
    else:
        speed, torque = 0.5 * ramp(0.5, 3), 0.3 * ramp(2, 3)
        last = [0.5, 0.3]
        for start in np.arange(6, 54, 6.0):
            new = [rng.uniform(0.25, 1.0), rng.uniform(-0.4, 1.0)]
            speed = speed + (new[0] - last[0]) * ramp(start, 2.5)
            torque = torque + (new[1] - last[1]) * ramp(start + 0.7, 2.0)
            last = new
    rough = np.convolve(rng.standard_normal(len(t)), np.hanning(120), "same")
    return t, NOMINAL_RAD_S * speed, NOMINAL_NM * (torque + 0.01 * rough / rough.std() * (abs(speed) > 0.05))


def motion(bench, speed, torque, effects):
    """Angles, torques of both shafts and the motor's torque, each sample."""
    (j0, j1, j2), (k0, k1), (c0, c1) = bench.inertia, bench.stiffness, bench.damping
    gap = effects.get("backlash", {}).get("gap", 0.0) / 2
    level = effects.get("friction", {}).get("level", 0.0)
    dt = 1 / (RATE_HZ * STEPS)
    a0 = a1 = a2 = w0 = w1 = w2 = bristle = integral = 0.0
    rows = []
    tanh, exp = math.tanh, math.exp
    for demand, load in zip(speed.tolist(), torque.tolist()):
        for _ in range(STEPS):
            error = demand - w0
            integral += error * dt
            drive = 60 * error + 90 * integral + load
            twist, rate = a0 - a1, w0 - w1
            if gap:
                twist = twist - gap if twist > gap else twist + gap if twist < -gap else 0.0
                first = k0 * twist + (c0 if twist else 0.05 * c0) * rate
            else:
                first = k0 * twist * (1 + 30 * twist * twist) + c0 * rate
            second = k1 * (a1 - a2) + c1 * (w1 - w2)
            friction = 0.0
            if level:  # LuGre, bristles over 1 mrad, 40 % more at standstill
                limit = level * (1 + 0.4 * exp(-((w2 / 3) ** 2)))
                slip = w2 - abs(w2) * bristle / limit * level / 1e-3 * 1e-3
                bristle += dt * (level / 1e-3) * (w2 - abs(w2) * bristle / limit)
                bristle = max(-limit, min(limit, bristle))
                friction = bristle + 0.001 * slip
            w0 += dt * (drive - first - 0.5 * bench.drag * w0) / j0
            w1 += dt * (first - second) / j1
            w2 += dt * (second - load * tanh(w2 / 0.5) - friction - 0.5 * bench.drag * w2) / j2
            a0 += dt * w0
            a1 += dt * w1
            a2 += dt * w2
        rows.append((a0, a2, first, second, drive, load * tanh(w2 / 0.5)))
    return np.array(rows).T


def lag(x, seconds):
    """First-order lag."""
    y, state, part = np.empty_like(x), x[0], 1 - math.exp(-1 / (RATE_HZ * seconds))
    for i, value in enumerate(x.tolist()):
        state += part * (value - state)
        y[i] = state
    return y


def readings(bench, t, rows, effects, temperature, rng):
    """Strain of each gauge."""
    a0, _, first, second, _, _ = rows
    out = []
    for i, name in enumerate(GAUGES):
        torque = (first if i < 4 else second).copy()
        level = torque / NOMINAL_NM
        group = name[:-2]
        of = lambda kind: effects[kind] if kind in effects and effects[kind].get("group", group) == group else None
        if effect := of("bend"):
            torque *= 1 + effect["size"] * np.tanh(1.5 * np.abs(level)) ** 1.5
        gain = bench.true_gain[i] * (1 + sum(a * np.cos(k * a0 + p) for a, p, k in bench.orders[i]))
        if (effect := of("gain")) and effect["gauge"] == i:
            gain = gain * (1 + effect["size"])
        if (effect := of("loose")) and effect["gauge"] == i:
            gain = gain * (1 - effect["size"] / (1 + np.exp(-(t - effect["at_s"]) / 0.2)))
        strain = bench.sensitivity[i] * gain * torque
        full = bench.sensitivity[i] * NOMINAL_NM
        if effect := of("creep"):
            strain = strain + full * effect["size"] * sum(lag(level, s) for s in (1.0, 4.0, 16.0, 64.0)) / 4
        if of("warmth"):
            strain = strain + effects["warmth"]["size"] * abs(full) * (temperature - temperature[0]) * (1 + 0.1 * i)
        if of("bursts"):
            for at in rng.uniform(5, t[-1] - 5, 10):
                strain = strain + 0.15 * full * (abs(t - at) < 0.4) * np.sin(2 * math.pi * 3.1 * (t - at))
        strain = lag(strain, 2e-3)  # the amplifier's filter
        if effect := of("late"):
            strain = lag(lag(strain, effect["size"] / 2), effect["size"] / 2)
        noise = rng.standard_t(5, len(t)) * 3e-7 / math.sqrt(5 / 3)
        out.append(np.round((strain + bench.zero[i] + noise) / 1e-8) * 1e-8)
    return out


def draw(kind, rng):
    """An effect of that kind, of a size that matters."""
    group = str(rng.choice(["housing", "flange"]))
    sign = float(rng.choice([-1, 1]))
    return {
        "gain": {"gauge": int(rng.integers(6)), "size": sign * rng.uniform(0.03, 0.1)},
        "friction": {"level": NOMINAL_NM * rng.uniform(0.015, 0.05)},
        "creep": {"group": group, "size": rng.uniform(0.02, 0.06)},
        "warmth": {"size": sign * rng.uniform(0.003, 0.01)},
        "bend": {"group": group, "size": sign * rng.uniform(0.04, 0.12)},
        "late": {"group": group, "size": rng.uniform(0.02, 0.06)},
        "loose": {"gauge": int(rng.integers(6)), "size": rng.uniform(0.1, 0.5), "at_s": rng.uniform(20, 40)},
        "backlash": {"gap": rng.uniform(2e-3, 8e-3)},
        "bursts": {"group": group},
    }[kind]


def record(bench, profile, effects, seed, path):
    """Simulates `effects` ({kind: parameters}) and writes a recording."""
    rng = np.random.default_rng(seed + 1000)
    t, speed, torque = course(profile, seed)
    rows = motion(bench, speed, torque, effects)
    # The oil warms the housing: two lags of the power, and what the hall does.
    power = np.abs(rows[2] * np.gradient(rows[0], t)) / (NOMINAL_NM * NOMINAL_RAD_S)
    temperature = 25 + 4 * lag(lag(power, 25.0), 6.0) + 0.02 * rng.standard_normal(len(t))
    strain = readings(bench, t, rows, effects, temperature, rng)
    counts = {name: np.floor(a * c / math.tau).astype(np.int64) for (name, c), a in zip(COUNTS.items(), rows[:2])}
    turns = np.floor(rows[0] / math.tau)
    latched = [None] + [
        int(max(a, b) * COUNTS["encoder_motor"]) if a != b else None for a, b in zip(turns[:-1], turns[1:])
    ]
    table = {"t [s]": t}
    table |= {f"{name} [counts]": values for name, values in counts.items()}
    table["index [counts]"] = pa.array(latched, pa.int64())
    table |= {f"{name} [m/m]": values for name, values in zip(GAUGES, strain)}
    for name, values in (("torque_motor", rows[4]), ("torque_brake", rows[5])):
        table[f"{name} [Nm]"] = values + 5e-4 * NOMINAL_NM * rng.standard_normal(len(t))
    table["temperature [°C]"] = np.round(temperature, 2)
    pq.write_table(pa.table(table), path)

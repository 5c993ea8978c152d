"""Reference results for the filters of loadtwin_common, in double precision.

Made with Python 3.11, filterpy 1.4.5, numpy 2.4.6, scipy 1.17.1:
    pip install filterpy==1.4.5 numpy==2.4.6 scipy==1.17.1
    python filters.py        (writes the CSV files beside itself)

Each row is one step: measurements, then the posterior state, then the upper
triangle of the posterior covariance column by column. The models are those
of ../tests/kalman/model.rs.
"""

import pathlib

import numpy as np
from filterpy.kalman import (
    ExtendedKalmanFilter,
    KalmanFilter,
    MerweScaledSigmaPoints,
    UnscentedKalmanFilter,
)
from scipy.linalg import solve_discrete_are
from scipy.signal import butter, lfilter

HERE = pathlib.Path(__file__).parent
rng = np.random.default_rng(2023)


def upper(p):
    return [p[i, j] for j in range(len(p)) for i in range(j + 1)]


def write(name, rows):
    np.savetxt(HERE / name, np.array(rows), delimiter=",", fmt="%.10g")


# Two inertias on a shaft, an unknown torque on the first: twist, two speeds, load.
F = np.array([[1, 0.01, -0.01, 0], [-0.5, 0.98, 0.02, 0.01], [0.25, 0.01, 0.99, 0], [0, 0, 0, 1]])
Q = np.diag([1e-6, 1e-4, 1e-4, 0.25])
Q[1, 2] = Q[2, 1] = 5e-5
H = np.array([[0, 1, 0, 0], [2, 0, 0.5, 0.1]])
R = np.diag([0.01, 0.04])

kf = KalmanFilter(dim_x=4, dim_z=2)
kf.F, kf.Q, kf.H, kf.R = F, Q, H, R
kf.x, kf.P = np.zeros((4, 1)), np.diag([0.1, 1, 1, 100.0])
truth, rows = np.array([0, 0, 0, 8.0]), []
for k in range(200):
    truth = F @ truth
    z = H @ truth + rng.normal(0, np.sqrt(np.diag(R)))
    kf.predict()
    kf.update(z.reshape(2, 1))
    rows.append([*z, *kf.x.ravel(), *upper(kf.P)])
write("kalman.csv", rows)

# The same in its steady state: P+ from the Riccati equation, constant gain.
prior = solve_discrete_are(F.T, H.T, Q, R)
K = prior @ H.T @ np.linalg.inv(H @ prior @ H.T + R)
posterior = (np.eye(4) - K @ H) @ prior
write("steady_gain.csv", [[*row] for row in K])
x, steady = np.zeros(4), []
for row in rows:
    x = F @ x
    x = x + K @ (np.array(row[:2]) - H @ x)
    steady.append([*row[:2], *x, *upper(posterior)])
write("steady.csv", steady)

# A pendulum with an unknown torque: angle, speed, load.
DT = 0.01


def f(x, dt=DT):
    return np.array([x[0] + dt * x[1], x[1] + dt * (x[2] - 9.81 * np.sin(x[0])), x[2]])


def jacobian(x):
    return np.array([[1, DT, 0], [-9.81 * DT * np.cos(x[0]), 1, DT], [0, 0, 1]])


def h(x):
    return np.array([np.sin(x[0]), x[1] + 0.1 * x[1] ** 2])


def h_jacobian(x):
    x = np.asarray(x).ravel()
    return np.array([[np.cos(x[0]), 0, 0], [0, 1 + 0.2 * x[1], 0]])


QP, RP = np.diag([1e-6, 1e-4, 0.01]), np.diag([1e-3, 4e-3])
P0 = np.diag([0.1, 0.5, 4.0])
truth, measured = np.array([0.6, 0.0, 2.0]), []
for k in range(200):
    truth = f(truth)
    measured.append(h(truth) + rng.normal(0, np.sqrt(np.diag(RP))))

ekf = ExtendedKalmanFilter(dim_x=3, dim_z=2)
ekf.x, ekf.P, ekf.Q, ekf.R = np.zeros((3, 1)), P0.copy(), QP, RP
rows = []
for z in measured:
    ekf.F = jacobian(ekf.x.ravel())
    ekf.x = f(ekf.x.ravel()).reshape(3, 1)
    ekf.P = ekf.F @ ekf.P @ ekf.F.T + ekf.Q
    ekf.update(z.reshape(2, 1), h_jacobian, lambda x: h(x.ravel()).reshape(2, 1))
    rows.append([*z, *ekf.x.ravel(), *upper(ekf.P)])
write("extended.csv", rows)


def root(p):
    """Rows are the columns of the upper triangular S with S S' = P."""
    return np.linalg.cholesky(p[::-1, ::-1])[::-1, ::-1].T


# Channels 1 and 2 again, and a third that depends on everything.
def h3(x):
    return np.array([*h(x), x[0] * x[2] + 0.05 * x[2] ** 2])


R3 = np.diag([1e-3, 4e-3, 0.1])
points = MerweScaledSigmaPoints(3, alpha=0.8, beta=2.0, kappa=0.5, sqrt_method=root)
ukf = UnscentedKalmanFilter(3, 3, DT, h3, f, points)
ukf.x, ukf.P, ukf.Q, ukf.R = np.zeros(3), P0.copy(), QP, R3
truth, rows = np.array([0.6, 0.0, 2.0]), []
for k in range(200):
    truth = f(truth)
    z = h3(truth) + rng.normal(0, np.sqrt(np.diag(R3)))
    ukf.predict()
    ukf.sigmas_f = points.sigma_points(ukf.x, ukf.P)  # drawn again, with Q in them
    ukf.update(z)
    rows.append([*z, *ukf.x, *upper(ukf.P)])
write("unscented.csv", rows)

# Second-order Butterworth, 25 Hz at 1 kHz, low and high.
u = 1.0 + rng.normal(size=500)
low = lfilter(*butter(2, 25, "low", fs=1000), u)
high = lfilter(*butter(2, 25, "high", fs=1000), u)
write("butterworth.csv", np.column_stack([u, low, high]))

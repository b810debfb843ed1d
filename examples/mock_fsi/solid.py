"""Mock structural code: a cantilever beam in its first bending modes, advanced with Newmark's method.

It answers a coupling partner over ZeroMQ, one JSON object for each request:

    {"op": "interface", "points": [[x, y], …]}   → {"nodes": n}               the wet nodes, beam from x0 to x0 + length
    {"op": "advance", "force": [[fx, fy], …]}    → {"displacement": [[ux, uy], …]}   end of the step, from its start
    {"op": "commit"}                             → {"step": n}                the last advance becomes the new start
    {"op": "stop"}                               → {"step": n}

`advance` may be requested any number of times: each starts from the last committed step, as implicit coupling needs.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass

import numpy as np
import zmq

#: Roots of cosh(β) cos(β) = -1: the clamped-free Euler–Bernoulli beam.
BETA = np.array([1.8751040687, 4.6940911330])
NEWMARK_BETA, NEWMARK_GAMMA = 0.25, 0.5  # average acceleration: no numerical damping


@dataclass(frozen=True)
class Beam:
    """A clamped-free beam, SI units, unit width."""

    x0: float = 0.25
    centre_y: float = 0.2
    length: float = 0.35
    thickness: float = 0.02
    density: float = 1000.0
    youngs_modulus: float = 1.4e6

    @property
    def mass(self) -> float:
        """Mass per length, kg/m."""
        return self.density * self.thickness

    @property
    def frequencies(self) -> np.ndarray:
        """(modes,) angular frequencies, rad/s."""
        stiffness = self.youngs_modulus * self.thickness**3 / 12
        return BETA**2 * np.sqrt(stiffness / (self.mass * self.length**4))

    def modes(self, points: np.ndarray) -> np.ndarray:
        """(n, 2, modes) displacement of the points (n, 2) by each mode: w across, and -(y - yc) w' along the beam."""
        s = np.clip((points[:, 0] - self.x0) / self.length, 0.0, 1.0)[:, None] * BETA
        ratio = (np.sinh(BETA) - np.sin(BETA)) / (np.cosh(BETA) + np.cos(BETA))
        across = np.cosh(s) - np.cos(s) - ratio * (np.sinh(s) - np.sin(s))
        slope = (np.sinh(s) + np.sin(s) - ratio * (np.cosh(s) - np.cos(s))) * BETA / self.length
        along = -(points[:, 1] - self.centre_y)[:, None] * slope
        return np.stack([along, across], axis=1)


class Structure:
    """Modal state at the last committed step, and the trial of the current one."""

    def __init__(self, beam: Beam, points: np.ndarray, dt: float) -> None:
        self.shape = beam.modes(points)
        self.modal_mass = np.full(len(BETA), beam.mass * beam.length)  # ∫ w² of these modes is the length
        self.stiffness = self.modal_mass * beam.frequencies**2
        self.dt = dt
        self.step = 0
        self.state = np.zeros((3, len(BETA)))  # displacement, velocity, acceleration
        self.trial = self.state

    def advance(self, force: np.ndarray) -> np.ndarray:
        """Displacement (n, 2) at the end of the step under nodal forces (n, 2) acting at its end."""
        q, v, a = self.state
        dt = self.dt
        predicted = q + dt * v + dt**2 * (0.5 - NEWMARK_BETA) * a
        modal_force = np.einsum("nik,ni->k", self.shape, force)
        acceleration = (modal_force - self.stiffness * predicted) / (
            self.modal_mass + NEWMARK_BETA * dt**2 * self.stiffness
        )
        self.trial = np.stack(
            [
                predicted + NEWMARK_BETA * dt**2 * acceleration,
                v + dt * ((1 - NEWMARK_GAMMA) * a + NEWMARK_GAMMA * acceleration),
                acceleration,
            ]
        )
        return self.shape @ self.trial[0]

    def commit(self) -> None:
        """Use the result of the last advance as the start of the next step."""
        self.state, self.step = self.trial, self.step + 1


def answer(structure: Structure | None, request: dict, dt: float) -> tuple[Structure | None, dict]:
    """Execute one request; return the structure afterwards and the reply."""
    op = request["op"]
    if op == "interface":
        points = np.array(request["points"], dtype=float)
        return Structure(Beam(), points, dt), {"nodes": len(points)}
    if structure is None:
        return None, {"error": f"{op!r} before 'interface'"}
    if op == "advance":
        return structure, {"displacement": structure.advance(np.array(request["force"], dtype=float)).tolist()}
    if op == "commit":
        structure.commit()
    elif op != "stop":
        return structure, {"error": f"unknown op {op!r}"}
    return structure, {"step": structure.step}


def main() -> int:
    """Serve one coupling partner until it sends stop, or sends nothing for too long."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bind", default="tcp://127.0.0.1:5560")
    parser.add_argument("--dt", type=float, default=0.02)
    parser.add_argument("--patience", type=float, default=120.0, help="end after this many seconds without a request")
    options = parser.parse_args()
    structure: Structure | None = None
    with zmq.Context() as context, context.socket(zmq.REP) as socket:
        socket.setsockopt(zmq.LINGER, 2000)
        for option in (zmq.RCVTIMEO, zmq.SNDTIMEO):
            socket.setsockopt(option, int(options.patience * 1000))
        socket.bind(options.bind)
        sys.stdout.write(f"solid: listening on {socket.getsockopt_string(zmq.LAST_ENDPOINT)}\n")
        sys.stdout.flush()
        while True:
            try:
                request = socket.recv_json()
            except zmq.Again:
                sys.stderr.write(f"solid: no request for {options.patience:g} s, giving up\n")
                return 1
            structure, reply = answer(structure, request, options.dt)
            socket.send_json(reply)
            if request["op"] == "stop":
                return 0


if __name__ == "__main__":
    sys.exit(main())

"""Mock fluid code: implicit coupling of a load stub, the beam of solid.py and the mesh-motion server.

The load stub replaces a flow solver: a force across the flag, p0 sin(2πft), minus an *added mass* times the
acceleration of the wet surface, so that the load depends on the displacement that it causes. With the added mass as
large as the beam's own, plain iteration diverges and Aitken's relaxation is needed, as with a real incompressible flow.
Every coupling iteration moves the mesh through the server; between iterations the step is rolled back, as a solver with
checkpoints does; a converged step is committed.
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path

import numpy as np
import zmq
from mesh_motion_client import Mesh, connect

NEWMARK_BETA, NEWMARK_GAMMA = 0.25, 0.5
ROLES = {"flag": "moving", "cylinder": "fixed", "inlet": "fixed", "outlet": "fixed", "walls": "fixed"}


class LoadStub:
    """Nodal forces on the wet nodes from time and motion; stores the motion of the last committed step."""

    def __init__(self, points: np.ndarray, *, dt: float, added_mass: float, amplitude: float, frequency: float) -> None:
        self.share = np.full(len(points), 0.35 / len(points))  # each node's share of the flag's length
        self.dt, self.added_mass, self.amplitude, self.frequency = dt, added_mass, amplitude, frequency
        self.motion = np.zeros((3, len(points), 2))  # displacement, velocity, acceleration

    def acceleration(self, displacement: np.ndarray) -> np.ndarray:
        """Newmark's acceleration (n, 2) for a displacement (n, 2) at the end of the step."""
        d, v, a = self.motion
        dt = self.dt
        return (displacement - d - dt * v) / (NEWMARK_BETA * dt**2) - (0.5 / NEWMARK_BETA - 1) * a

    def force(self, time: float, displacement: np.ndarray) -> np.ndarray:
        """(n, 2) nodal forces at the end of the step."""
        force = np.zeros_like(displacement)
        pressure = self.amplitude * np.sin(2 * np.pi * self.frequency * time)
        force[:, 1] = self.share * (pressure - self.added_mass * self.acceleration(displacement)[:, 1])
        return force

    def commit(self, displacement: np.ndarray) -> None:
        """Use the converged displacement as the start of the next step."""
        _, v, a = self.motion
        new = self.acceleration(displacement)
        velocity = v + self.dt * ((1 - NEWMARK_GAMMA) * a + NEWMARK_GAMMA * new)
        self.motion = np.stack([displacement, velocity, new])


class Solid:
    """The structural code at the other end of a request socket."""

    def __init__(self, context: zmq.Context, endpoint: str, timeout: float) -> None:
        self.socket = context.socket(zmq.REQ)
        for option in (zmq.RCVTIMEO, zmq.SNDTIMEO):
            self.socket.setsockopt(option, int(timeout * 1000))
        self.socket.setsockopt(zmq.LINGER, 2000)
        self.socket.connect(endpoint)

    def ask(self, op: str, **data: object) -> dict:
        """One request and its reply."""
        self.socket.send_json({"op": op, **data})
        reply = self.socket.recv_json()
        if "error" in reply:
            raise RuntimeError(f"solid: {reply['error']}")
        return reply


def aitken(omega: float, residual: np.ndarray, previous: np.ndarray | None) -> float:
    """Aitken's relaxation factor from two successive residuals (Küttler and Wall 2008, eq. 44)."""
    if previous is None:
        return omega
    change = residual - previous
    return float(-omega * np.sum(previous * change) / np.sum(change * change))


def couple_step(session, solid: Solid, load: LoadStub, time: float, options: argparse.Namespace):
    """Iterate one time step to convergence; return the accepted displacement, the last reply and the iterations."""
    displacement, previous, omega = load.motion[0] + load.dt * load.motion[1], None, options.relaxation
    for iteration in range(1, options.max_iterations + 1):
        answered = np.array(solid.ask("advance", force=load.force(time, displacement).tolist())["displacement"])
        residual = answered - displacement
        omega = aitken(omega, residual, previous)
        displacement, previous = displacement + omega * residual, residual
        if iteration > 1:
            session.rollback()
        moved = session.move(displacement)
        if np.max(np.abs(residual)) <= options.tolerance:
            return displacement, moved, iteration
    raise RuntimeError(f"no convergence in {options.max_iterations} iterations at t = {time:g} s")


def run(session, solid: Solid, load: LoadStub, options: argparse.Namespace, points: np.ndarray) -> list[dict]:
    """All time steps; one row for each step."""
    tip = int(np.argmax(points[:, 0]))
    rows = []
    for step in range(1, options.steps + 1):
        time = step * load.dt
        displacement, moved, iterations = couple_step(session, solid, load, time, options)
        committed = session.commit()
        solid.ask("commit")
        load.commit(displacement)
        quality = committed.quality["size_skew"]["min"]
        rows.append(
            {"step": step, "time": time, "tip": displacement[tip, 1], "iterations": iterations, "min_quality": quality}
        )
        sys.stdout.write(f"step {step:3d}  tip {displacement[tip, 1]:+.5f} m  {iterations:2d} iterations  "
                         f"min size-skew {quality:.3f}  {' '.join(moved.warnings)}\n")  # fmt: skip
        sys.stdout.flush()
    return rows


def arguments() -> argparse.Namespace:
    """The command line."""
    here = Path(__file__).resolve().parent
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--server", help="endpoint of the mesh-motion server; default: a private one")
    parser.add_argument("--solid", default="tcp://127.0.0.1:5560")
    parser.add_argument("--mesh", type=Path, default=here.parent / "turek_hron_flag" / "mesh.npz")
    parser.add_argument("--out", type=Path, default=Path("out/mock_fsi"))
    parser.add_argument("--steps", type=int, default=50)
    parser.add_argument("--dt", type=float, default=0.02)
    parser.add_argument("--added-mass", type=float, default=20.0, help="kg/m; the beam itself has 20")
    parser.add_argument("--amplitude", type=float, default=30.0, help="N/m")
    parser.add_argument("--frequency", type=float, default=1.0, help="Hz")
    parser.add_argument("--relaxation", type=float, default=0.3, help="first relaxation factor of a step")
    parser.add_argument("--tolerance", type=float, default=1e-9, help="m, largest residual of a converged step")
    parser.add_argument("--max-iterations", type=int, default=50)
    parser.add_argument("--keep-solid", action="store_true", help="do not stop the solid at the end")
    parser.add_argument("--timeout", type=float, default=120.0, help="seconds for any answer")
    return parser.parse_args()


def main() -> int:
    """Couple the codes and write fsi.csv."""
    options = arguments()
    mesh = Mesh.load(options.mesh, ROLES)
    options.out.mkdir(parents=True, exist_ok=True)
    with (
        zmq.Context() as context,
        connect(options.server, timeout=options.timeout) as server,
        server.open(mesh, {"displacement": "absolute"}, label="mock fsi") as session,
    ):
        solid = Solid(context, options.solid, options.timeout)
        points = mesh.points[session.moving_nodes]
        solid.ask("interface", points=points.tolist())
        load = LoadStub(points, dt=options.dt, added_mass=options.added_mass,
                        amplitude=options.amplitude, frequency=options.frequency)  # fmt: skip
        rows = run(session, solid, load, options, points)
        if not options.keep_solid:
            solid.ask("stop")
        solid.socket.close()
    with (options.out / "fsi.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    sys.stdout.write(f"fluid: {len(rows)} steps coupled, written to {options.out / 'fsi.csv'}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

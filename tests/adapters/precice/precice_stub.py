"""A stand-in for preCICE 3 that plays the other participants from a script and makes the same refusals as preCICE.

The script is the configuration file, in JSON::

    {"meshes": {"Wet": {"points": null, "data": ["Displacement"]},          points: those of a received mesh
                "Volume": {"points": null, "data": ["NodeDisplacement"]}},
     "dimensions": 2, "window": 0.1, "iterations": [1, 3, 2], "explicit": false, "initial_data": false,
     "motion": [[a, b], [c, d]]}

Window w is computed ``iterations[w]`` times. The displacement at a point is ``motion @ point`` times a function of
time; in all iterations of a window except the last it is wrong by a half, a quarter, … Within a window it is linear in
time, like preCICE's waveforms of first order. ``begin``: number of windows before a restart. ``wait_in_finalize``: a
participant that finalizes early, its destructor included, waits for the others for ever. ``interrupt``: Ctrl-C comes in
that step. Errors of preCICE's checks are errors here too, with the same text.
"""

import json
import os
import signal
import threading
from pathlib import Path

import numpy as np

_TIGHT = 1e-14


class PreciceError(RuntimeError):
    """The error with which preCICE ends a program."""


def check(condition, words):
    if not condition:
        raise PreciceError(words)


def amplitude(time):
    """Position of the other participant at that time, as a share of the script's motion."""
    return 1.0 - np.cos(2.0 * time)


class Script:
    def __init__(self, values):
        self.dimensions = values.get("dimensions", 2)
        self.window = values.get("window", 0.1)
        self.explicit = values.get("explicit", False)
        self.iterations = values["iterations"]
        self.initial_data = values.get("initial_data", False)
        self.motion = np.array(values["motion"], dtype=float)
        self.meshes = values["meshes"]
        self.begin = values.get("begin", 0)
        self.since_window = values.get("since_window", False)
        self.connectivity = values.get("connectivity", False)
        self.wait_in_finalize = values.get("wait_in_finalize", False)
        self.interrupt = values.get("interrupt", 0)

    def displacement(self, points, window, iteration, fraction):
        """(n, d) displacement of the points at a fraction of a window, in one of its iterations (from 1)."""
        start, end = (amplitude((self.begin + window + more) * self.window) for more in (0, 1))
        off = 0.0 if iteration == self.iterations[window] else 0.5**iteration
        value = start + fraction * (end * (1.0 + off) - start)
        return (value - (start if self.since_window else 0.0)) * points @ self.motion.T


class Participant:
    """The methods of pyprecice that an adapter of this kind may use."""

    def __init__(
        self, solver_name, configuration_file_name, solver_process_index, solver_process_size, communicator=None
    ):
        check(0 <= solver_process_index < solver_process_size, "The process index needs to be smaller than the size.")
        values = configuration_file_name
        if not isinstance(values, dict):
            values = json.loads(Path(configuration_file_name).read_text())
        check(solver_name == values.get("participant", "MeshMotion"), f"no participant {solver_name} is configured")
        self.script = Script(values)
        self.log = Path(values["log"]) if "log" in values else None
        self.state = "constructed"
        self.points = {}
        self.initial = {}
        self.connected = {}
        self.regions = set()
        self.written = {}
        self.history = []  # (window, iteration, fraction of the window, {(mesh, data): values}, read checkpoint)
        self.calls = []
        self.window, self.iteration, self.passed = 0, 1, 0.0
        self.unfulfilled = {"initial data"} if self.script.initial_data else set()
        self.complete = False

    # --- before the coupling -----------------------------------------------------------------------------------------

    def get_mesh_dimensions(self, mesh_name):
        check(mesh_name in self.script.meshes, f'The given mesh name "{mesh_name}" is unknown to preCICE.')
        return self.script.dimensions

    def get_data_dimensions(self, mesh_name, data_name):
        self._check_data(mesh_name, data_name)
        return 1 if data_name == self.script.meshes[mesh_name].get("scalar") else self.script.dimensions

    def requires_mesh_connectivity_for(self, mesh_name):
        check(mesh_name in self.script.meshes, f'The given mesh name "{mesh_name}" is unknown to preCICE.')
        return self.script.connectivity

    def set_mesh_edges(self, mesh_name, vertices):
        self._connect(mesh_name, vertices, 2)

    def set_mesh_triangle(self, mesh_name, first_vertex_id, second_vertex_id, third_vertex_id):
        triangle = np.array([[first_vertex_id, second_vertex_id, third_vertex_id]])
        self._connect(mesh_name, triangle, 3)

    def set_mesh_triangles(self, mesh_name, vertices):
        assert self.script.dimensions == 3, "the bindings compare with the dimension of the mesh"
        self._connect(mesh_name, vertices, 3)

    def set_mesh_tetrahedra(self, mesh_name, vertices):
        self._connect(mesh_name, vertices, 4)

    def get_mesh_vertex_size(self, mesh_name):
        return len(self.points[mesh_name])

    def set_mesh_vertices(self, mesh_name, positions):
        check(self.state == "constructed", f'This participant attempted to modify the Mesh "{mesh_name}" while locked.')
        check(self.script.meshes[mesh_name].get("points") is None, f'Mesh "{mesh_name}" is received, not provided.')
        positions = np.asarray(positions)
        assert positions.shape[1] == self.get_mesh_dimensions(mesh_name)
        before = len(self.points.setdefault(mesh_name, np.empty((0, self.script.dimensions))))
        self.points[mesh_name] = np.concatenate([self.points[mesh_name], positions])
        return np.arange(before, before + len(positions), dtype=np.int32)

    def set_mesh_access_region(self, mesh_name, bounding_box):
        check(self.script.meshes[mesh_name].get("points") is not None, f'mesh "{mesh_name}" is not a received mesh')
        check(self.state == "constructed", "setMeshAccessRegion() needs to be called before initialize().")
        check(mesh_name not in self.regions, "setMeshAccessRegion may only be called once per mesh.")
        box = np.asarray(bounding_box)
        assert len(box) == 2 * self.get_mesh_dimensions(mesh_name)
        check((box[::2] <= box[1::2]).all(), "Your bounding box is ill defined, i.e. it has a negative volume.")
        self.regions.add(mesh_name)
        points = np.array(self.script.meshes[mesh_name]["points"])
        self.points[mesh_name] = points[((box[::2] <= points) & (points <= box[1::2])).all(axis=1)]

    def get_mesh_vertex_ids_and_coordinates(self, mesh_name):
        check(mesh_name in self.regions, "no access region was defined although this is necessary")
        check(self.state == "initialized", "initialize() has to be called before accessing data of the received mesh")
        points = self.points[mesh_name]
        return np.arange(len(points), dtype=np.int32), points.copy()

    def requires_initial_data(self):
        check(self.state == "constructed", "requiresInitialData() has to be called before initialize().")
        return self._fulfil("initial data")

    def initialize(self):
        check(self.state == "constructed", "initialize() may only be called once.")
        check("initial data" not in self.unfulfilled, "Initial data has to be written to preCICE before initialize().")
        self.state, self.initial, self.written = "initialized", self.written, {}
        self._begin_window()

    # --- the coupling ------------------------------------------------------------------------------------------------

    def is_coupling_ongoing(self):
        check(self.state == "initialized", "initialize() has to be called before isCouplingOngoing() can be evaluated.")
        return self.window < len(self.script.iterations)

    def is_time_window_complete(self):
        check(self.state == "initialized", "initialize() has to be called before isTimeWindowComplete().")
        return self.complete

    def get_max_time_step_size(self):
        check(self.state == "initialized", "initialize() has to be called before getMaxTimeStepSize().")
        return self.script.window - self.passed if self.is_coupling_ongoing() else 0.0

    def requires_writing_checkpoint(self):
        check(self.state == "initialized", "initialize() has to be called before requiresWritingCheckpoint().")
        return self._fulfil("write checkpoint")

    def requires_reading_checkpoint(self):
        check(self.state == "initialized", "initialize() has to be called before requiresReadingCheckpoint().")
        return self._fulfil("read checkpoint")

    def read_data(self, mesh_name, data_name, vertex_ids, relative_read_time):
        check(self.state == "initialized", "readData(...) cannot be called before initialize().")
        inside = relative_read_time <= self.get_max_time_step_size() + _TIGHT
        check(inside, "readData(...) cannot sample data outside of current time window.")
        check(relative_read_time >= 0, "readData(...) cannot sample data before the current time.")
        self._check_data(mesh_name, data_name)
        points = self._chosen(mesh_name, vertex_ids)
        fraction = (self.passed + relative_read_time) / self.script.window
        return self.script.displacement(points, self.window, self.iteration, fraction)

    def write_data(self, mesh_name, data_name, vertex_ids, values):
        ongoing = self.state == "constructed" or self.is_coupling_ongoing()
        check(ongoing, "Calling writeData(...) is forbidden if coupling is not ongoing")
        self._check_data(mesh_name, data_name)
        writable = data_name not in self.script.meshes[mesh_name].get("read_only", [])
        check(writable, f'This participant does not use data "{data_name}", but attempted to write it.')
        values = np.asarray(values)
        if not len(values):
            return
        assert values.shape == (len(vertex_ids), self.get_data_dimensions(mesh_name, data_name))
        check(np.isfinite(values).all(), "One of the given data values is either plus or minus infinity or NaN.")
        buffer = self.written.setdefault((mesh_name, data_name), np.zeros_like(self.points[mesh_name]))
        self._chosen(mesh_name, vertex_ids)
        buffer[vertex_ids] = values

    def advance(self, computed_timestep_length):
        check(self.state == "initialized", "initialize() has to be called before advance().")
        check(self.is_coupling_ongoing(), "advance() cannot be called when isCouplingOngoing() returns false.")
        check(computed_timestep_length > 0.0, "advance() cannot be called with a time step size of 0.")
        left = self.get_max_time_step_size()
        check(computed_timestep_length <= left + _TIGHT, "The time step size given to preCICE exceeds the maximum.")
        if self.script.interrupt == len(self.history) + 1:
            os.kill(os.getpid(), signal.SIGINT)
        check(not self.unfulfilled, f"The required actions {', '.join(sorted(self.unfulfilled))} are not fulfilled.")
        self.passed += computed_timestep_length
        written, self.written = self.written, {}  # what is not written again is zero
        self.history.append((self.window, self.iteration, self.passed / self.script.window, written))
        self.complete = False
        if self.passed < self.script.window - _TIGHT:
            return
        self.passed = 0.0
        if self.iteration < self.script.iterations[self.window]:
            self.iteration += 1
            self.unfulfilled.add("read checkpoint")
            return
        self.complete, self.window, self.iteration = True, self.window + 1, 1
        self._begin_window()

    def finalize(self):
        check(self.state != "finalized", "finalize() may only be called once.")
        if self.script.wait_in_finalize and self.state == "initialized" and self.is_coupling_ongoing():
            threading.Event().wait()
        self.state = "finalized"
        if self.log is not None:
            with self.log.open("wb") as file:
                np.savez(file, *(next(iter(entry[3].values())) for entry in self.history))

    def __del__(self):
        if getattr(self, "state", "finalized") == "initialized":
            self.finalize()

    # --- inside ------------------------------------------------------------------------------------------------------

    def _begin_window(self):
        if self.is_coupling_ongoing() and not self.script.explicit:
            self.unfulfilled.add("write checkpoint")

    def _fulfil(self, action):
        required = action in self.unfulfilled
        self.unfulfilled.discard(action)
        self.calls += [action] * required
        return required

    def _check_data(self, mesh_name, data_name):
        known = mesh_name in self.script.meshes and data_name in self.script.meshes[mesh_name]["data"]
        check(known, f'Data "{data_name}" is unknown on mesh "{mesh_name}".')

    def _connect(self, mesh_name, vertices, nodes):
        check(self.state == "constructed", f'This participant attempted to modify the Mesh "{mesh_name}" while locked.')
        assert vertices.shape[1] == nodes
        for column in vertices.T:
            self._chosen(mesh_name, column)
        self.connected.setdefault(mesh_name, []).extend(vertices)

    def _chosen(self, mesh_name, vertex_ids):
        ids = np.asarray(vertex_ids)
        check(((ids >= 0) & (ids < len(self.points[mesh_name]))).all(), "invalid Vertex ID")
        return self.points[mesh_name][ids]

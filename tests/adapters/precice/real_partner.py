"""The other participant of a script (precice_stub.py), in a separate process with the real preCICE."""

import json
import sys

import numpy as np
import precice
from precice_stub import Script

CONFIG = """<?xml version="1.0" encoding="UTF-8" ?>
<precice-configuration wait-in-finalize="{wait}">
  <data:vector name="Displacement" />
  <data:vector name="NodeDisplacement" />
  <mesh name="Partner-Wet" dimensions="2"><use-data name="Displacement" /></mesh>
  <mesh name="Partner-Volume" dimensions="2"><use-data name="NodeDisplacement" /></mesh>
  <mesh name="Lower" dimensions="2"><use-data name="Displacement" /></mesh>
  <mesh name="Upper" dimensions="2"><use-data name="Displacement" /></mesh>
  <mesh name="Volume" dimensions="2"><use-data name="NodeDisplacement" /></mesh>
  <participant name="Partner">
    <provide-mesh name="Partner-Wet" />
    <provide-mesh name="Partner-Volume" />
    <receive-mesh name="Volume" from="MeshMotion" />
    <write-data name="Displacement" mesh="Partner-Wet" />
    <read-data name="NodeDisplacement" mesh="Partner-Volume" />
    <mapping:{mapping} direction="read" from="Volume" to="Partner-Volume" constraint="consistent" />
  </participant>
  <participant name="MeshMotion">
    <provide-mesh name="Lower" />
    <provide-mesh name="Upper" />
    <provide-mesh name="Volume" />
    <receive-mesh name="Partner-Wet" from="Partner" />
    <read-data name="Displacement" mesh="Lower" />
    <read-data name="Displacement" mesh="Upper" />
    <write-data name="NodeDisplacement" mesh="Volume" />
    <mapping:nearest-neighbor direction="read" from="Partner-Wet" to="Lower" constraint="consistent" />
    <mapping:nearest-neighbor direction="read" from="Partner-Wet" to="Upper" constraint="consistent" />
  </participant>
  <m2n:sockets acceptor="Partner" connector="MeshMotion" />
  <coupling-scheme:serial-{kind}>
    <participants first="Partner" second="MeshMotion" />
    <time-window-size value="{window}" />
    <max-time-windows value="{windows}" />
    {iterations}
    <exchange data="Displacement" mesh="Partner-Wet" from="Partner" to="MeshMotion" substeps="true" />
    <exchange data="NodeDisplacement" mesh="Volume" from="MeshMotion" to="Partner" substeps="true" />
  </coupling-scheme:serial-{kind}>
</precice-configuration>
"""


def config(script):
    """preCICE's configuration for a script with the same number of iterations in all windows."""
    count = script["iterations"][0]
    limits = f'<min-iterations value="{count}" /><max-iterations value="{count}" />'
    return CONFIG.format(
        wait=str(script.get("wait_in_finalize", False)).lower(),
        mapping=script.get("mapping", "nearest-neighbor"),
        kind="explicit" if script.get("explicit") else "implicit",
        window=script.get("window", 0.1),
        windows=len(script["iterations"]),
        iterations="" if script.get("explicit") else limits,
    )


def main(folder):
    """Play the script; write the data read at the end of each window to read.npz."""
    with open(f"{folder}/partner.json", encoding="utf-8") as file:
        values = json.load(file)
    script, points, wet = Script(values), np.array(values["points"]), np.array(values["wet"])
    coupling = precice.Participant("Partner", f"{folder}/precice-config.xml", 0, 1)
    wet_ids = coupling.set_mesh_vertices("Partner-Wet", points[wet])
    ids = coupling.set_mesh_vertices("Partner-Volume", points)
    coupling.initialize()
    window, iteration, read = 0, 1, []
    while coupling.is_coupling_ongoing():
        coupling.requires_writing_checkpoint()
        moved = script.displacement(points[wet], window, iteration, 1.0)
        coupling.write_data("Partner-Wet", "Displacement", wet_ids, moved)
        coupling.advance(coupling.get_max_time_step_size())
        if coupling.requires_reading_checkpoint():
            iteration += 1
            continue
        window, iteration = window + 1, 1
        read.append(coupling.read_data("Partner-Volume", "NodeDisplacement", ids, 0.0))
    coupling.finalize()
    np.savez(f"{folder}/read.npz", np.array(read))


if __name__ == "__main__":
    main(sys.argv[1])

"""Velocities that Kratos' own function computes from displacements: ``velocities_in_kratos.py IN.json OUT.json``.

The input has ``scheme``, ``times`` (s + 1) and ``displacements`` (s + 1, n, 3), the output the velocities (s, n, 3).
"""

import json
import sys
from pathlib import Path

import KratosMultiphysics as KM
import KratosMultiphysics.MeshMovingApplication as Moving

given = json.loads(Path(sys.argv[1]).read_text())
scheme = {"bdf1": KM.TimeDiscretization.BDF1, "bdf2": KM.TimeDiscretization.BDF2}.get(given["scheme"])
part = KM.Model().CreateModelPart("mesh", 3)
for variable in (KM.MESH_DISPLACEMENT, KM.MESH_VELOCITY, KM.MESH_ACCELERATION):
    part.AddNodalSolutionStepVariable(variable)
for number in range(len(given["displacements"][0])):
    part.CreateNewNode(number + 1, 0.0, 0.0, 0.0)
rule = KM.TimeDiscretization.Bossak() if scheme is None else scheme()
found = []
for step, (time, rows) in enumerate(zip(given["times"], given["displacements"], strict=True)):
    if step:
        part.CloneTimeStep(time)
        part.ProcessInfo[KM.STEP] = step
    else:
        part.ProcessInfo[KM.TIME] = time
    for node, row in zip(part.Nodes, rows, strict=True):
        node.SetSolutionStepValue(KM.MESH_DISPLACEMENT, row)
    if step:
        Moving.CalculateMeshVelocities(part, rule)
        found.append([list(node.GetSolutionStepValue(KM.MESH_VELOCITY)) for node in part.Nodes])
Path(sys.argv[2]).write_text(json.dumps(found))

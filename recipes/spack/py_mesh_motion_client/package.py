# Copyright Spack Project Developers. See COPYRIGHT file for details.
#
# SPDX-License-Identifier: (Apache-2.0 OR MIT)

from spack_repo.builtin.build_systems.python import PythonPackage

from spack.package import *


class PyMeshMotionClient(PythonPackage):
    """Python client of the mesh-motion server, which moves the volume mesh of a coupled run."""

    pypi = "mesh-motion-client/mesh_motion_client-0.1.0.tar.gz"

    license("BSD-3-Clause")

    version("0.1.0", sha256="0000000000000000000000000000000000000000000000000000000000000000")

    depends_on("python@3.11:", type=("build", "run"))
    depends_on("py-scikit-build-core@0.11:", type="build")
    depends_on("py-numpy@1.26:", type=("build", "run"))
    depends_on("py-msgpack@1.0.7:", type=("build", "run"))
    depends_on("py-pyzmq@26:", type=("build", "run"))

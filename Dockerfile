# Three images from one file: `server` runs sessions; `client` is what a solver's container needs (numpy, msgpack, pyzmq);
# `openfoam` has OpenFOAM with the motion solver, CalculiX, and the driver that couples them.
ARG BASE=debian:bookworm-slim

FROM ${BASE} AS python
# The folders are the user's from the start: a named volume takes the owner of the folder it is first mounted on.
RUN apt-get update \
 && apt-get install -y --no-install-recommends python3 python3-venv \
 && rm -rf /var/lib/apt/lists/* /var/cache/apt/* \
 && python3 -m venv /opt/mesh-motion \
 && useradd --uid 10001 --create-home --shell /usr/sbin/nologin mesh \
 && install -d -o mesh -g mesh -m 0700 /run/mesh-motion /var/lib/mesh-motion \
 && install -d -o mesh -g mesh /results
ENV PATH=/opt/mesh-motion/bin:$PATH PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1
WORKDIR /src

# The wheels are built apart: the images that run have the packages alone, and what their lock files name.
FROM python AS build
RUN apt-get update && apt-get install -y --no-install-recommends g++ python3-dev && rm -rf /var/lib/apt/lists/*
COPY requirements requirements
RUN pip install --no-cache-dir --require-hashes -r requirements/build.lock
COPY pyproject.toml README.md LICENSE ./
COPY numerics numerics
COPY docs/man docs/man
COPY mesh_motion_server mesh_motion_server
COPY protocol protocol
COPY adapters adapters
RUN pip wheel --no-cache-dir --no-deps --no-build-isolation --wheel-dir /wheels ./adapters/python ./numerics .

FROM python AS client
COPY requirements/client.lock ./
RUN pip install --no-cache-dir --require-hashes -r client.lock
COPY --from=build /wheels /wheels
RUN pip install --no-cache-dir --no-deps /wheels/mesh_motion_client-*.whl
COPY examples /examples
USER mesh
WORKDIR /home/mesh

FROM python AS server
COPY requirements/server.lock ./
# A tenth of scipy and numpy are their own tests.
RUN pip install --no-cache-dir --require-hashes -r server.lock \
 && find /opt/mesh-motion -type d -name tests -prune -exec rm -r {} +
COPY --from=build /wheels /wheels
RUN pip install --no-cache-dir --no-deps /wheels/*.whl
USER mesh
WORKDIR /home/mesh
ENTRYPOINT ["mesh-motion"]
CMD ["serve", "--endpoint", "ipc:///run/mesh-motion/control", "--state", "/var/lib/mesh-motion", "--metrics", "127.0.0.1:9464"]

# The motion solver is compiled apart: the image that runs needs no compiler and no headers.
FROM ${BASE} AS motion-solver
RUN apt-get update \
 && apt-get install -y --no-install-recommends openfoam libzmq3-dev gcc g++ libc6-dev make bzip2 ca-certificates
COPY adapters/c /src/adapters/c
COPY adapters/openfoam /src/adapters/openfoam
RUN OUT=/src/adapters/openfoam/build /src/adapters/openfoam/Allwmake

FROM client AS openfoam
USER root
RUN apt-get update \
 && apt-get install -y --no-install-recommends openfoam calculix-ccx libzmq5 \
 && rm -rf /var/lib/apt/lists/*
RUN pip install --no-cache-dir --no-deps /wheels/mesh_motion_server-*.whl
COPY --from=motion-solver /src/adapters/openfoam/build /src/adapters/openfoam/build
COPY examples /src/examples
USER mesh

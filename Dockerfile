# Two images from one file: `server` runs sessions; `client` is what a solver's container needs (numpy, msgpack, pyzmq).
ARG BASE=debian:bookworm-slim

FROM ${BASE} AS python
# The folders are the user's from the start: a named volume takes the owner of the folder it is first mounted on.
RUN apt-get update \
 && apt-get install -y --no-install-recommends python3 python3-venv \
 && rm -rf /var/lib/apt/lists/* \
 && python3 -m venv /opt/mesh-motion \
 && useradd --uid 10001 --create-home --shell /usr/sbin/nologin mesh \
 && install -d -o mesh -g mesh -m 0700 /run/mesh-motion /var/lib/mesh-motion \
 && install -d -o mesh -g mesh /results
ENV PATH=/opt/mesh-motion/bin:$PATH PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1
WORKDIR /src
COPY pyproject.toml README.md LICENSE ./
COPY mesh_motion_server mesh_motion_server
COPY protocol protocol
COPY adapters adapters

FROM python AS client
RUN pip install --no-cache-dir .
COPY examples /examples
USER mesh
WORKDIR /home/mesh

FROM python AS server
# The kernels are compiled into the image, so that no session waits for them. Numba wants to write where it reads: the
# container, which is read-only, copies them to its memory first.
ENV NUMBA_CACHE_DIR=/tmp/kernels
RUN pip install --no-cache-dir '.[server]' \
 && cd / && mesh-motion version --warm \
 && mv /tmp/kernels /opt/mesh-motion/kernels && chmod -R a+rX /opt/mesh-motion
USER mesh
WORKDIR /home/mesh
ENTRYPOINT ["sh", "-c", "cp -r /opt/mesh-motion/kernels /tmp/ && exec mesh-motion \"$@\"", "mesh-motion"]
CMD ["serve", "--endpoint", "ipc:///run/mesh-motion/control", "--state", "/var/lib/mesh-motion", "--metrics", "127.0.0.1:9464"]
